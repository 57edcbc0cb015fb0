//! Which second it is, by vote.

/// Labels in agreement that set the first number.
const VOTES_TO_SET: u8 = 3;
/// Labels in agreement, one a second, that overthrow a number in use: half a minute. A receiver that is
/// late under load, or has just learnt of a leap second, is wrong for less.
const VOTES_TO_CHANGE: u8 = 30;

/// The number of the second that a clock's own count began with, voted by the labels of a receiver.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct SecondLabel {
    offset_s: Option<i64>,
    candidate_s: i64,
    votes: u8,
}

impl SecondLabel {
    /// Nothing known.
    pub(super) const fn new() -> Self {
        Self { offset_s: None, candidate_s: 0, votes: 0 }
    }

    /// Seconds from the clock's own count to the receiver's, once known.
    pub(super) const fn offset_s(&self) -> Option<i64> {
        self.offset_s
    }

    /// A label votes for an offset. Says whether the offset in use was set or changed by it.
    pub(super) fn vote(&mut self, offset_s: i64) -> bool {
        if self.offset_s == Some(offset_s) {
            self.votes = 0;
            return false;
        }
        self.votes = if self.candidate_s == offset_s { self.votes.saturating_add(1) } else { 1 };
        self.candidate_s = offset_s;
        let needed = if self.offset_s.is_some() { VOTES_TO_CHANGE } else { VOTES_TO_SET };
        if self.votes < needed {
            return false;
        }
        self.offset_s = Some(offset_s);
        self.votes = 0;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_in_a_row_set_it() {
        let mut label = SecondLabel::new();
        let set: Vec<_> = [7, 7, 8, 7, 7, 7].into_iter().map(|s| label.vote(s)).collect();
        assert_eq!(set, [false, false, false, false, false, true]);
        assert_eq!(label.offset_s(), Some(7));
    }

    #[test]
    fn a_first_label_of_zero_has_one_vote() {
        let mut label = SecondLabel::new();
        assert!(!label.vote(0));
        assert!(!label.vote(0));
        assert!(label.vote(0));
    }

    #[test]
    fn only_lasting_disagreement_changes_it() {
        let mut label = SecondLabel::new();
        assert!((0..3).any(|_| label.vote(7)));
        (0..29).for_each(|_| assert!(!label.vote(8)));
        assert!(!label.vote(7));
        (0..29).for_each(|_| assert!(!label.vote(8)));
        assert_eq!(label.offset_s(), Some(7));
        assert!(label.vote(8));
        assert_eq!(label.offset_s(), Some(8));
    }
}
