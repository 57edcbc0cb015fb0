//! The sector of flash that keeps who the board is, its key and the count of its boots.

use embassy_stm32::Peri;
use embassy_stm32::flash::{Blocking, Flash};
use embassy_stm32::peripherals::FLASH;
use skyroost_firmware::board::autopilot::Given;
use skyroost_firmware::board::provision::{PROVISION_LEN, Provision, ProvisionError, next_boot};

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
    pub(crate) fn provision(&mut self) -> Result<Provision, Given> {
        let mut bytes = [0; PROVISION_LEN];
        self.flash.blocking_read(SECTOR, &mut bytes).map_err(|_| Given::Damaged)?;
        Provision::read(&bytes).map_err(|error| match error {
            ProvisionError::Empty => Given::Nothing,
            ProvisionError::Format | ProvisionError::Checksum => Given::Damaged,
        })
    }

    /// Spends a boot and returns its epoch, once it is sure that it will never come again.
    pub(crate) fn boot(&mut self) -> Result<u16, Given> {
        let (epoch, offset) = next_boot(|offset| self.is_spent(offset)).ok_or(Given::Spent)?;
        let written = self.flash.blocking_write(SECTOR + offset as u32, &[0; 4]);
        if written.is_ok() && self.is_spent(offset) { Ok(epoch) } else { Err(Given::Spent) }
    }

    fn is_spent(&mut self, offset: usize) -> bool {
        let mut word = [0; 4];
        // A word that cannot be read is not to be spent twice.
        self.flash.blocking_read(SECTOR + offset as u32, &mut word).is_err() || word != [0xff; 4]
    }
}
