//! How well frames get through to a drone, by what it says itself: how long they take, and how many are lost.

use skyroost_protocol::units::TimePs;

/// A delay longer than the longest lately counts at once; the longest lately is forgotten by this share with every shorter one.
const DELAY_SHARE: i64 = 64;
/// A loss is learned by this share with every telemetry: ten seconds.
const LOSS_SHARE: f64 = 0.1;
/// What is said once must get through with no less than this probability.
const SURE: f64 = 0.9;
/// Most times that one thing is said.
const MOST_COPIES: usize = 3;
/// Fewer frames between two telemetries say little of a loss.
const LEAST_SENT: u32 = 4;

/// How well frames get through.
#[derive(Clone, Copy, Debug, Default)]
pub struct Quality {
    /// The longest that a frame took lately.
    delay: TimePs,
    /// The share of frames that are lost on the way to the drone.
    loss: f64,
    /// Frames sent and frames lost, as of the last telemetry.
    counted: Option<(u32, u32)>,
}

impl Quality {
    /// A frame from the drone took so long, by GNSS time.
    pub(super) fn took(&mut self, delay: TimePs) {
        let shorter = self.delay.since(delay).0;
        self.delay = if shorter > 0 { TimePs(self.delay.0 - shorter / DELAY_SHARE) } else { delay };
    }

    /// The drone has lost so many of so many frames since it booted.
    pub(super) fn lost(&mut self, sent: u32, lost: u32) {
        let Some((sent_before, lost_before)) = self.counted else {
            self.counted = Some((sent, lost));
            return;
        };
        let (sent_since, lost_since) = (sent.wrapping_sub(sent_before), lost.wrapping_sub(lost_before));
        if sent_since < LEAST_SENT {
            return;
        }
        self.counted = Some((sent, lost));
        // A drone that has started anew counts anew.
        if lost_since <= sent_since {
            self.loss += LOSS_SHARE * (f64::from(lost_since) / f64::from(sent_since) - self.loss);
        }
    }

    /// The longest that a frame took lately.
    #[must_use]
    pub fn delay(&self) -> TimePs {
        self.delay
    }

    /// How often something is to be said that is not acknowledged.
    #[must_use]
    pub fn copies(&self) -> usize {
        let through = |copies: usize| 1.0 - self.loss.powi(copies as i32);
        (1..MOST_COPIES).find(|copies| through(*copies) >= SURE).unwrap_or(MOST_COPIES)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_delay_is_known_at_once_and_slowly_forgotten() {
        let mut quality = Quality::default();
        for ms in [80, 500, 80, 90] {
            quality.took(TimePs::from_ms(ms));
        }
        assert!(quality.delay() > TimePs::from_ms(480));
        (0..600).for_each(|_| quality.took(TimePs::from_ms(80)));
        assert!(quality.delay() < TimePs::from_ms(82));
    }

    #[test]
    fn what_gets_lost_is_said_more_often() {
        for (loss, copies) in [(0.0, 1), (0.05, 1), (0.3, 2), (0.6, 3), (0.9, 3)] {
            let mut quality = Quality::default();
            for second in 1..100_u32 {
                quality.lost(100 * second, (100.0 * loss) as u32 * second);
            }
            assert_eq!(quality.copies(), copies, "{loss}");
        }
        // A drone that has started anew, and one that hardly anything is said to.
        let mut quality = Quality::default();
        [(0, 1_000), (100, 3), (101, 4), (102, 5)]
            .into_iter()
            .for_each(|(sent, lost)| quality.lost(sent, lost));
        assert_eq!(quality.copies(), 1);
    }
}
