//! A 32-bit timer in 64 bits, by itself.

/// Extends the values of a free-running 32-bit timer to 64 bits.
///
/// [`srs::capture::TickExtender`](crate::srs::capture::TickExtender) does the same with GNSS time beside it;
/// this one is what GNSS time is made from, and so has nothing but the timer.
///
/// Assumption: the timer is read at least every half wrap (25 s at 84 MHz). A board that has not been
/// read for that long has long been reset by its watchdog.
///
/// ```
/// use skyroost_firmware::board::ticks::TickCounter;
///
/// let mut counter = TickCounter::starting_at(u32::MAX - 9);
/// assert_eq!(counter.read(5) - counter.extend(u32::MAX), 6);
/// ```
#[derive(Clone, Debug)]
pub struct TickCounter {
    ticks: i64,
}

impl TickCounter {
    /// A counter whose timer reads `timer`.
    #[must_use]
    pub const fn starting_at(timer: u32) -> Self {
        Self { ticks: timer as i64 }
    }

    /// The timer reads `timer`: that reading in 64 bits. Readings go only forwards.
    pub const fn read(&mut self, timer: u32) -> i64 {
        self.ticks = self.ticks.wrapping_add(timer.wrapping_sub(self.ticks as u32) as i64);
        self.ticks
    }

    /// A value captured within half a wrap before or after the last reading, in 64 bits.
    #[must_use]
    pub const fn extend(&self, capture: u32) -> i64 {
        self.ticks.wrapping_add(capture.wrapping_sub(self.ticks as u32) as i32 as i64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::{collection::vec, prelude::*};

    proptest! {
        /// Over any number of wraps, readings and captures are where they were.
        #[test]
        fn truth_follows_the_count(
            start: u32,
            steps in vec((0..i64::from(i32::MAX), -0x7fff_ffff..0x7fff_ffff_i64), 1..100),
        ) {
            let mut counter = TickCounter::starting_at(start);
            let mut ticks = i64::from(start);
            for (step, from_reading) in steps {
                ticks += step;
                prop_assert_eq!(counter.read(ticks as u32), ticks);
                let capture = ticks + from_reading;
                prop_assert_eq!(counter.extend(capture as u32), capture);
            }
        }
    }
}
