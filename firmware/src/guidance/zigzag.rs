//! The shared phase along the lanes.
//!
//! All three drones integrate the same speed profile from the same start time, so their phases agree
//! without a word. What they tell each other only mends differences: each leans towards the mean of
//! the phases it hears, and all slow down together when one of them falls behind its slot.

use super::lanes::{ALONG_ACCEL_MPS2, Cursor, Lanes, TrackPoint};
use crate::{
    STEP_S,
    scalar::{greater, within},
};
use heapless::Vec;
use skyroost_protocol::units::{DroneId, TimePs};

/// Error from the slot up to which the fleet keeps its speed, metres.
const KEEP_SPEED_ERROR_M: f32 = 4.0;
/// Error from the slot at which the fleet stops and waits, metres.
const STOP_ERROR_M: f32 = 15.0;
/// Gain from phase difference to rate, 1/s.
const CONSENSUS_GAIN_PER_S: f32 = 0.4;
/// Greatest change of the rate for the sake of agreement, metres a second.
const CONSENSUS_LIMIT_MPS: f32 = 0.5;
/// A mate's word counts for this long.
const MATE_FRESH: TimePs = TimePs::from_ms(2_000);
/// Least speed commanded towards a corner or the end, so that they are reached, metres a second.
const CREEP_MPS: f32 = 0.2;

/// Where a fleet mate stands on the lanes, as it said.
#[derive(Clone, Copy, Debug, PartialEq)]
struct MatePhase {
    drone: DroneId,
    time: TimePs,
    phase_um: i64,
    rate_mps: f32,
    error_m: f32,
}

/// What follows the lanes.
#[derive(Clone, Debug, Default)]
pub struct Zigzag {
    phase_um: i64,
    speed_mps: f32,
    accel_mps2: f32,
    cursor: Cursor,
    /// The track at `phase_um`, once it was looked up.
    here: Option<TrackPoint>,
    mates: Vec<MatePhase, 2>,
}

impl Zigzag {
    /// At the start of the lanes, at rest.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            phase_um: 0,
            speed_mps: 0.0,
            accel_mps2: 0.0,
            cursor: Cursor::new(),
            here: None,
            mates: Vec::new(),
        }
    }

    /// Way flown along the lanes, micrometres.
    #[must_use]
    pub fn phase_um(&self) -> i64 {
        self.phase_um
    }

    /// Rate of the phase, metres a second.
    #[must_use]
    pub fn speed_mps(&self) -> f32 {
        self.speed_mps
    }

    /// Rate of change of the rate, metres a second squared.
    #[must_use]
    pub fn accel_mps2(&self) -> f32 {
        self.accel_mps2
    }

    /// A fleet mate says where it stands. Words out of order are ignored.
    pub fn hear(&mut self, drone: DroneId, time: TimePs, phase_um: i64, rate_mps: f32, error_m: f32) {
        let said = MatePhase { drone, time, phase_um, rate_mps, error_m };
        match self.mates.iter_mut().find(|m| m.drone == drone) {
            Some(known) if known.time < time => *known = said,
            Some(_) => {}
            // A fleet has two mates; a third voice is not ours and finds no room.
            None => drop(self.mates.push(said)),
        }
    }

    /// Runs the phase on by one step and returns the track there; `error_m` is this drone's distance
    /// from its slot. None without lanes.
    pub fn advance(&mut self, now: TimePs, lanes: &Lanes, error_m: f32) -> Option<TrackPoint> {
        let here = match self.here {
            Some(here) => here,
            None => self.look_up(lanes)?,
        };
        let mut worst_error_m = error_m;
        let (mut ahead_um, mut heard) = (0i64, 0i64);
        for mate in &self.mates {
            let age = now.since(mate.time);
            if age > MATE_FRESH {
                continue;
            }
            worst_error_m = greater(worst_error_m, mate.error_m);
            let moved_um = (mate.rate_mps * age.as_secs_f32() * 1e6) as i64;
            // What a frame says is only a number: no phase lies outside the lanes, and within them nothing overflows.
            let stands_um = mate.phase_um.saturating_add(moved_um).max(0).min(lanes.length_um());
            ahead_um += stands_um - self.phase_um;
            heard += 1;
        }
        let share = (STOP_ERROR_M - worst_error_m) / (STOP_ERROR_M - KEEP_SPEED_ERROR_M);
        let profile = greater(here.speed_limit_mps, CREEP_MPS) * within(share, 0.0, 1.0);
        // Mean over the fleet, this drone (difference zero) included.
        let lean = ahead_um as f32 * (1e-6 * CONSENSUS_GAIN_PER_S) / (heard + 1) as f32;
        let wanted = greater(profile + within(lean, -CONSENSUS_LIMIT_MPS, CONSENSUS_LIMIT_MPS), 0.0);
        let before = self.speed_mps;
        let most = ALONG_ACCEL_MPS2 * STEP_S;
        // Braking follows the profile even where it asks for a little more than accelerating may.
        self.speed_mps = within(wanted, greater(before - 2.0 * most, 0.0), before + most);
        self.accel_mps2 = (self.speed_mps - before) / STEP_S;
        self.phase_um = (self.phase_um + (self.speed_mps * (STEP_S * 1e6)) as i64).min(lanes.length_um());
        self.look_up(lanes)
    }

    /// The track where the phase stands. None without lanes.
    pub fn look_up(&mut self, lanes: &Lanes) -> Option<TrackPoint> {
        self.here = lanes.at(self.phase_um, &mut self.cursor);
        self.here
    }

    /// Whether the end of the lanes is reached.
    #[must_use]
    pub fn done(&self, lanes: &Lanes) -> bool {
        self.phase_um >= lanes.length_um()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lanes() -> Lanes {
        Lanes::new(&[[0, 0], [500_000, 0], [500_000, 300_000]], 10.0, f32::INFINITY).unwrap()
    }

    #[test]
    fn without_a_word_two_drones_agree_to_the_bit() {
        let (lanes, mut a, mut b) = (lanes(), Zigzag::default(), Zigzag::default());
        for step in 0..5_000 {
            let now = TimePs::from_ms(step * 20);
            assert_eq!(a.advance(now, &lanes, 0.1), b.advance(now, &lanes, 0.3));
        }
        assert_eq!(a.phase_um(), b.phase_um());
        assert!(a.phase_um() > 400_000_000);
    }

    #[test]
    fn a_laggard_is_waited_for_and_a_difference_heals() {
        let lanes = lanes();
        let mut late = Zigzag::default();
        let mut early = Zigzag { phase_um: 3_000_000, ..Zigzag::default() };
        for step in 0..1_000 {
            let now = TimePs::from_ms(step * 20);
            if step % 10 == 0 {
                late.hear(DroneId(1), now, early.phase_um(), early.speed_mps(), 0.0);
                early.hear(DroneId(2), now, late.phase_um(), late.speed_mps(), 0.0);
            }
            late.advance(now, &lanes, 0.0);
            early.advance(now, &lanes, 0.0);
        }
        assert!((early.phase_um() - late.phase_um()).abs() < 300_000, "{early:?} {late:?}");
        let now = TimePs::from_ms(20_000);
        early.hear(DroneId(2), now, late.phase_um(), 0.0, 20.0);
        for step in 0..250 {
            early.advance(TimePs::from_ms(20_000 + step), &lanes, 0.0);
        }
        assert!(early.speed_mps() <= CONSENSUS_LIMIT_MPS, "the fleet waits");
    }

    #[test]
    fn a_mate_beyond_the_lanes_counts_as_one_at_their_end() {
        let lanes = lanes();
        let end = |phase_um: i64, rate_mps: f32| {
            let mut z = Zigzag { phase_um: 3_000_000, ..Zigzag::default() };
            z.advance(TimePs::from_ms(0), &lanes, 0.0);
            z.hear(DroneId(1), TimePs::from_ms(0), phase_um, rate_mps, 0.0);
            z.advance(TimePs::from_ms(20), &lanes, 0.0);
            (z.phase_um(), z.speed_mps().to_bits())
        };
        assert_eq!(end(i64::MAX, f32::MAX), end(lanes.length_um(), 0.0));
        assert_eq!(end(i64::MAX, -f32::MAX), end(0, 0.0), "a mate that flies back fast enough");
        assert_eq!(end(i64::MIN, f32::MIN), end(0, 0.0));
    }

    #[test]
    fn the_end_is_reached_exactly() {
        let (lanes, mut z) = (lanes(), Zigzag::default());
        for step in 0..6_000 {
            z.advance(TimePs::from_ms(step * 20), &lanes, 0.0);
        }
        assert!(z.done(&lanes));
        assert_eq!(z.phase_um(), lanes.length_um());
    }
}
