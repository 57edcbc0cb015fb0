//! Counts of everything the agent had to drop, refuse or clamp: nothing is lost silently.

/// Declares the counts once, and with them whatever has to name each of them.
macro_rules! counters {
    ($($(#[$doc:meta])* $name:ident,)*) => {
        /// Counts since boot; each saturates rather than wraps.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        pub struct Counters {
            $($(#[$doc])* pub $name: u32,)*
        }

        impl Counters {
            /// How many counts there are.
            pub const COUNT: usize = [$(stringify!($name)),*].len();

            /// Nothing counted yet.
            #[must_use]
            pub const fn new() -> Self {
                Self { $($name: 0,)* }
            }

            /// All counts, in the order in which they are declared.
            #[must_use]
            pub const fn to_array(&self) -> [u32; Self::COUNT] {
                [$(self.$name,)*]
            }

            /// The counts of [`to_array`](Self::to_array).
            #[must_use]
            pub const fn from_array([$($name,)*]: [u32; Self::COUNT]) -> Self {
                Self { $($name,)* }
            }
        }
    };
}

counters! {
    /// Frames that did not decode.
    frames_rejected,
    /// Frames that were not sealed with the key they have to be sealed with: forged, damaged, or of a boot that is over.
    frames_forged,
    /// Frames seen before, or too old for the sequence window.
    frames_repeated,
    /// Frames of a kind that has no business on this link.
    frames_unexpected,
    /// Messages that nobody was there for: on a sealed link, before the control center has answered.
    frames_unbound,
    /// Frames that did not fit the outputs of a step.
    frames_overflowed,
    /// SRS requests that came after the time of transmission.
    srs_late,
    /// SRS requests that did not fit the table of pending occasions.
    srs_overflowed,
    /// Captures of an occasion that was not pending.
    captures_unknown,
    /// Captures of fleet mates that did not fit a frame.
    captures_overflowed,
    /// Neighbours pushed out of the full table.
    peers_evicted,
    /// Lane pieces outside the announced mission.
    lanes_refused,
    /// Inputs that were not finite numbers.
    not_finite,
    /// Captures of a symbol that was captured before, or that no SRS has.
    symbols_refused,
    /// Captures of symbols that the others of their SRS did not agree with.
    symbols_excluded,
    /// Pulses per second off the grid of seconds.
    pulses_rejected,
    /// Times that the capture clock gave its grid of seconds up for another.
    pulses_replaced,
    /// Steps more than half a wrap of the capture timer after the step before: its captures could not be placed.
    timer_gaps,
    /// Pages of users heard that the uplink had no room for: the next ones come in a second.
    pages_dropped,
    /// Times that differences or telemetry began to wait for room on the uplink: put off and not lost.
    frames_put_off,
}

impl Counters {
    /// Frames that could not be read, forged ones among them.
    #[must_use]
    pub fn unreadable(&self) -> u32 {
        self.frames_rejected.saturating_add(self.frames_forged)
    }

    /// Adds one, saturating.
    pub fn count(counter: &mut u32) {
        *counter = counter.saturating_add(1);
    }

    /// Everything but frames that could not be read or were put off, in one number for telemetry.
    #[must_use]
    pub fn dropped(&self) -> u32 {
        let lost = Self { frames_rejected: 0, frames_forged: 0, frames_put_off: 0, ..*self };
        lost.to_array().iter().fold(0, |sum, n| sum.saturating_add(*n))
    }
}
