//! The sector of flash that keeps who the board is, its key and the count of its boots.

use embassy_stm32::Peri;
use embassy_stm32::flash::{Blocking, FLASH_BASE, Flash};
use embassy_stm32::peripherals::FLASH;
use skyroost_firmware::board::autopilot::Given;
use skyroost_firmware::board::provision::{PROVISION_LEN, Provision, ProvisionError, SECTOR_LEN, next_boot};

/// Offset of the sector in flash: the last of the chip (RM0090, table 5: sector 11), beyond any image (`memory.x`).
const SECTOR: u32 = 0xe_0000;

/// The sector.
pub(crate) struct Sector {
    flash: Flash<'static, Blocking>,
}

impl Sector {
    pub(crate) fn new(flash: Peri<'static, FLASH>) -> Self {
        Self { flash: Flash::new_blocking(flash) }
    }

    /// What the board was given.
    pub(crate) fn provision(&self) -> Result<Provision, Given> {
        let mut bytes = [0; PROVISION_LEN];
        for (at, word) in bytes.chunks_exact_mut(4).enumerate() {
            word.iter_mut().zip(read(4 * at).to_le_bytes()).for_each(|(to, from)| *to = from);
        }
        Provision::read(&bytes).map_err(|error| match error {
            ProvisionError::Empty => Given::Nothing,
            ProvisionError::Format | ProvisionError::Checksum => Given::Damaged,
        })
    }

    /// Spends a boot and returns its epoch, once it is sure that it will never come again.
    pub(crate) fn boot(&mut self) -> Result<u16, Given> {
        let (epoch, offset) = next_boot(is_spent).ok_or(Given::Spent)?;
        let written = self.flash.blocking_write(SECTOR + offset as u32, &[0; 4]);
        if written.is_ok() && is_spent(offset) { Ok(epoch) } else { Err(Given::Spent) }
    }
}

fn is_spent(offset: usize) -> bool {
    read(offset) != u32::MAX
}

/// The word at an offset in the sector; zero beyond it.
fn read(offset: usize) -> u32 {
    if offset > SECTOR_LEN - 4 || !offset.is_multiple_of(4) {
        return 0;
    }
    let address = FLASH_BASE + SECTOR as usize + offset;
    // SAFETY: a whole word within the sector, which is mapped, always readable, and no part of any image.
    unsafe { core::ptr::read_volatile(core::ptr::with_exposed_provenance::<u32>(address)) }
}
