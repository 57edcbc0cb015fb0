//! What one end of a link may say where the link's rate is limited: every byte is paid for with time.
//!
//! A token bucket in one number. It keeps when all that was said will have been sent, were it sent at the rate: a time to come is a debt, a
//! time gone by is credit, and no more than [`BURST`] of it. What must be said is said and paid for, in debt or not; everything else asks
//! before ([`allows`](Budget::allows)), and so waits for whatever must be said. The transmitter's queue is then never longer than
//! [`BURST`], the debt that was allowed, and what had to be said.

use crate::stream::FRAMING;
use crate::units::TimePs;

/// Most credit, and so the longest that a transmitter which was idle is kept busy by what may wait: as long as from one shared state to the
/// next.
pub const BURST: TimePs = TimePs::from_ms(100);

/// Nanoseconds of a second.
const NS_PER_S: u32 = 1_000_000_000;
const PS_PER_NS: i64 = 1_000;

/// Credit and debt of one transmitter. Times may come in any order; those that run back give no credit.
///
/// ```
/// use skyroost_protocol::{budget::Budget, units::TimePs};
/// let mut budget = Budget::new(1_000);
/// let now = TimePs::from_ms(5_000);
/// assert!(budget.allows(now, TimePs(0)));
/// budget.pay(now, 193); // and 7 of framing: 200 ms, of which 100 ms were there
/// assert!(!budget.allows(now, TimePs(0)));
/// assert!(budget.allows(TimePs::from_ms(5_100), TimePs(0)));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// Time that a byte takes, nanoseconds; 0 where the rate is not limited.
    ns_per_byte: u32,
    /// When all that was paid for has been sent.
    even_at: TimePs,
}

impl Budget {
    /// A transmitter that sends so many bytes a second and has said nothing yet; 0 for one that sends any number.
    #[must_use]
    pub const fn new(bytes_per_s: u32) -> Self {
        // Rounded up: rather too slow than too fast.
        let ns_per_byte = if bytes_per_s == 0 { 0 } else { NS_PER_S.div_ceil(bytes_per_s) };
        Self { ns_per_byte, even_at: TimePs(i64::MIN) }
    }

    /// How long a frame of so many bytes takes, with what frames it on a byte link.
    #[must_use]
    pub const fn time_of(&self, frame_len: usize) -> TimePs {
        let bytes = (frame_len + FRAMING) as i64;
        TimePs(bytes.saturating_mul(self.ns_per_byte as i64).saturating_mul(PS_PER_NS))
    }

    /// Pays at `now` for a frame of so many bytes.
    pub fn pay(&mut self, now: TimePs, frame_len: usize) {
        self.even_at = self.even_at.max(now.since(BURST)).after(self.time_of(frame_len));
    }

    /// Whether something may be said at `now` by somebody who is allowed so much debt.
    #[must_use]
    pub fn allows(&self, now: TimePs, debt: TimePs) -> bool {
        self.even_at <= now.after(debt)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::MAX_FRAME;
    use proptest::collection::vec;
    use proptest::prelude::*;
    use std::vec::Vec;

    #[test]
    fn where_nothing_is_limited_everything_is_allowed() {
        let mut budget = Budget::new(0);
        for ms in [0, -5, 3, i64::MAX] {
            let now = TimePs::from_ms(ms);
            (0..10_000).for_each(|_| budget.pay(now, MAX_FRAME));
            assert!(budget.allows(now, TimePs(0)));
        }
        assert_eq!(budget.time_of(MAX_FRAME), TimePs(0));
    }

    #[test]
    fn a_debt_is_paid_off_with_time_and_credit_is_bounded() {
        let mut budget = Budget::new(1_000);
        let at = TimePs::from_ms;
        budget.pay(at(60_000), 293);
        assert!(!budget.allows(at(60_199), TimePs(0)), "300 ms less a burst");
        assert!(budget.allows(at(60_100), at(100)) && budget.allows(at(60_200), TimePs(0)));
        budget.pay(at(90_000), 293);
        assert!(!budget.allows(at(90_199), TimePs(0)), "half a minute is no more credit than a burst");
    }

    proptest! {
        /// Over any window, what asks before is sent no faster than the rate, but for a burst and the last frame; and what must be said makes it
        /// less and never more. Whoever waits is let through once what must be said leaves room.
        #[test]
        fn truth_over_any_window_the_rate_is_kept(
            bytes_per_s in 500..100_000_u32,
            steps in vec((1..60_i64, 0..=MAX_FRAME, any::<bool>(), 0..3_usize), 1..300),
        ) {
            let mut budget = Budget::new(bytes_per_s);
            let mut now = TimePs(0);
            let mut sent: Vec<(TimePs, usize)> = Vec::new();
            for (ms, frame_len, must, tries) in steps {
                now = now.after(TimePs::from_ms(ms));
                if must {
                    budget.pay(now, frame_len);
                }
                for _ in 0..tries {
                    if budget.allows(now, TimePs(0)) {
                        budget.pay(now, frame_len);
                        sent.push((now, frame_len + FRAMING));
                    }
                }
            }
            let rate = f64::from(bytes_per_s);
            for (first, &(from, _)) in sent.iter().enumerate() {
                let mut bytes = 0;
                for &(until, len) in &sent[first..] {
                    bytes += len;
                    let window_s = (until.since(from).0 + BURST.0) as f64 * 1e-12;
                    let most = rate * window_s + (MAX_FRAME + FRAMING) as f64;
                    prop_assert!(bytes as f64 <= most, "{bytes} bytes in {window_s} s at {rate}");
                }
            }
            // All debts end.
            let owed = budget.even_at.since(now).max(TimePs(0));
            prop_assert!(budget.allows(now.after(owed), TimePs(0)));
        }
    }
}
