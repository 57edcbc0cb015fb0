//! Counts of everything the agent had to drop, refuse or clamp: nothing is lost silently.

/// Counts since boot; each saturates rather than wraps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Frames that did not decode.
    pub frames_rejected: u32,
    /// Frames seen before, or too old for the sequence window.
    pub frames_repeated: u32,
    /// Frames of a kind that has no business on this link.
    pub frames_unexpected: u32,
    /// Frames that did not fit the outputs of a step.
    pub frames_overflowed: u32,
    /// SRS requests that came after the time of transmission.
    pub srs_late: u32,
    /// SRS requests that did not fit the table of pending occasions.
    pub srs_overflowed: u32,
    /// Captures of an occasion that was not pending.
    pub captures_unknown: u32,
    /// Captures of fleet mates that did not fit a frame.
    pub captures_overflowed: u32,
    /// Neighbours pushed out of the full table.
    pub peers_evicted: u32,
    /// Neighbours forgotten after long silence.
    pub peers_expired: u32,
    /// Lane pieces outside the announced mission.
    pub lanes_refused: u32,
    /// Inputs that were not finite numbers.
    pub not_finite: u32,
}

impl Counters {
    /// Nothing counted yet.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            frames_rejected: 0,
            frames_repeated: 0,
            frames_unexpected: 0,
            frames_overflowed: 0,
            srs_late: 0,
            srs_overflowed: 0,
            captures_unknown: 0,
            captures_overflowed: 0,
            peers_evicted: 0,
            peers_expired: 0,
            lanes_refused: 0,
            not_finite: 0,
        }
    }

    /// Adds one, saturating.
    pub fn count(counter: &mut u32) {
        *counter = counter.saturating_add(1);
    }

    /// How many counts there are.
    pub const COUNT: usize = 12;

    /// All counts, in the order in which they are declared.
    #[must_use]
    pub fn to_array(&self) -> [u32; Self::COUNT] {
        // Named in full, so that a new count cannot be forgotten.
        let Self {
            frames_rejected,
            frames_repeated,
            frames_unexpected,
            frames_overflowed,
            srs_late,
            srs_overflowed,
            captures_unknown,
            captures_overflowed,
            peers_evicted,
            peers_expired,
            lanes_refused,
            not_finite,
        } = *self;
        [
            frames_rejected,
            frames_repeated,
            frames_unexpected,
            frames_overflowed,
            srs_late,
            srs_overflowed,
            captures_unknown,
            captures_overflowed,
            peers_evicted,
            peers_expired,
            lanes_refused,
            not_finite,
        ]
    }

    /// The counts of [`to_array`](Self::to_array).
    #[must_use]
    pub fn from_array(counts: [u32; Self::COUNT]) -> Self {
        let [
            frames_rejected,
            frames_repeated,
            frames_unexpected,
            frames_overflowed,
            srs_late,
            srs_overflowed,
            captures_unknown,
            captures_overflowed,
            peers_evicted,
            peers_expired,
            lanes_refused,
            not_finite,
        ] = counts;
        Self {
            frames_rejected,
            frames_repeated,
            frames_unexpected,
            frames_overflowed,
            srs_late,
            srs_overflowed,
            captures_unknown,
            captures_overflowed,
            peers_evicted,
            peers_expired,
            lanes_refused,
            not_finite,
        }
    }

    /// Everything but the frames, in one number for telemetry.
    #[must_use]
    pub fn dropped(&self) -> u32 {
        [
            self.frames_repeated,
            self.frames_unexpected,
            self.frames_overflowed,
            self.srs_late,
            self.srs_overflowed,
            self.captures_unknown,
            self.captures_overflowed,
            self.peers_evicted,
            self.peers_expired,
            self.lanes_refused,
            self.not_finite,
        ]
        .iter()
        .fold(0, |sum, n| sum.saturating_add(*n))
    }
}
