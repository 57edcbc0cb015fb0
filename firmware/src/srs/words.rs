//! Times in tables.

use skyroost_protocol::units::TimePs;

/// A time in two words: in its own type it would pad everything around it to eight bytes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Words([u32; 2]);

impl Words {
    pub(super) const fn new(time: TimePs) -> Self {
        Self([time.0 as u32, (time.0 >> 32) as u32])
    }

    pub(super) const fn time(self) -> TimePs {
        let Self([low, high]) = self;
        TimePs((high as i64) << 32 | low as i64)
    }
}
