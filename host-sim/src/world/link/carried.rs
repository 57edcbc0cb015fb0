//! How much a transmitter is given to send.

use skyroost_protocol::stream::FRAMING;

/// A second, microseconds.
const SECOND_US: u64 = 1_000_000;

/// Bytes on the air, with what frames them on a byte link, in all and in the busiest second.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Carried {
    bytes: u64,
    /// The second of the last frame, and bytes in it.
    second: (u64, u64),
    busiest: u64,
}

impl Carried {
    /// A frame of so many bytes is sent.
    pub fn add(&mut self, now_us: u64, frame_len: usize) {
        let (second, bytes) = (now_us / SECOND_US, (frame_len + FRAMING) as u64);
        if second != self.second.0 {
            self.second = (second, 0);
        }
        self.second.1 += bytes;
        self.bytes += bytes;
        self.busiest = self.busiest.max(self.second.1);
    }

    /// Bits a second in the mean over so many seconds.
    #[must_use]
    pub fn mean_bits_per_s(&self, seconds: f64) -> f64 {
        if seconds > 0.0 { 8.0 * self.bytes as f64 / seconds } else { 0.0 }
    }

    /// Bits in the busiest second.
    #[must_use]
    pub fn most_bits_per_s(&self) -> u64 {
        8 * self.busiest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_counted_by_the_second() {
        let mut carried = Carried::default();
        for (ms, frame_len) in [(0, 93), (990, 93), (1_010, 143), (7_000, 0)] {
            carried.add(1_000 * ms, frame_len);
        }
        assert_eq!(carried.most_bits_per_s(), 1_600);
        assert!((carried.mean_bits_per_s(10.0) - 8.0 * 35.7).abs() < 1e-9);
    }
}
