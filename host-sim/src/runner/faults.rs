//! What goes wrong with a drone: its board starts anew, its clock jumps, its receivers fail, somebody attacks its link.

use crate::{
    rng::{self, Stream},
    scenario::{FaultKind, FaultTable, Scenario},
};
use rand_chacha::ChaCha8Rng;
use rand_core::Rng;
use skyroost_firmware::STEP_US;
use skyroost_protocol::{
    DecodeError,
    codec::{Frame, MAX_FRAME},
    header::{FLAG_UNBOUND, Header, MANAGEMENT_VERSION},
};

/// How far a clock jumps: a tenth of a millisecond, 30 km of light.
const JUMP_PS: f64 = 1e8;
/// What a drone shares is good for so long, seconds (`docs/safety.md`).
const STALE_S: f64 = 1.0;
/// After a time without navigation or link a drone needs so long until it keeps its distance as the others do, seconds.
const RECOVERY_S: f64 = 15.0;
/// An attacker sends this many frames a second, in each direction.
const FRAMES_PER_S: f64 = 20.0;
/// It remembers so many frames.
const REMEMBERED: usize = 64;

/// A fault of one drone.
#[derive(Clone, Copy, Debug)]
struct Fault {
    kind: FaultKind,
    from: u64,
    until: u64,
}

/// All that goes wrong with one drone.
#[derive(Debug)]
pub(super) struct DroneFaults {
    faults: Vec<Fault>,
    /// Steps in which it hears of nobody and nobody of it.
    cut_off: Vec<(u64, u64)>,
    pub(super) attacker: Attacker,
}

/// What goes wrong in a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Now {
    /// By how much the clock jumps, picoseconds.
    pub(super) jump_ps: f64,
    pub(super) captures_stuck: bool,
    pub(super) navigation_nan: bool,
    /// The board is down.
    pub(super) booting: bool,
    /// The board is back, and knows nothing.
    pub(super) boots: bool,
    pub(super) attack: bool,
    /// Nobody claims that it keeps its distance.
    pub(super) excused: bool,
}

/// The step in which a time lies.
fn step_of(s: f64) -> u64 {
    (s * 1e6 / STEP_US as f64 - 1e-6).ceil() as u64
}

impl DroneFaults {
    pub(super) fn new(scenario: &Scenario, drone: u32) -> Self {
        let of_drone = scenario.faults.iter().filter(|fault| fault.drone == Some(drone));
        let fault = |it: &FaultTable| {
            let (from, until) = (step_of(it.at_s), step_of(it.at_s + it.for_s));
            Fault { kind: it.kind, from, until: until.max(from + 1) }
        };
        let chance = rng::stream(scenario.seed, Stream::Faults, u64::from(drone));
        let cut_off =
            scenario.partitions.iter().filter(|it| it.drones.is_empty() || it.drones.contains(&drone));
        Self {
            faults: of_drone.map(fault).collect(),
            cut_off: cut_off
                .map(|it| (step_of(it.from_s + STALE_S), step_of(it.until_s + RECOVERY_S)))
                .collect(),
            attacker: Attacker::new(chance),
        }
    }

    /// What goes wrong in this step; steps come one after the other.
    pub(super) fn at(&self, step: u64) -> Now {
        let mut now = Now::default();
        for Fault { kind, from, until } in &self.faults {
            let lasts = (*from..*until).contains(&step);
            match kind {
                FaultKind::ClockJump if step == *from => now.jump_ps += JUMP_PS,
                FaultKind::CapturesStuck => now.captures_stuck |= lasts,
                FaultKind::NavigationNan => {
                    now.navigation_nan |= lasts;
                    now.excused |= (*from..*until + step_of(RECOVERY_S)).contains(&step);
                }
                FaultKind::BoardReset => {
                    now.booting |= lasts;
                    now.boots |= step == *until;
                }
                FaultKind::Attack => now.attack |= lasts,
                FaultKind::ClockJump | FaultKind::ControlKilled => {}
            }
        }
        now.boots &= !now.booting;
        now.excused |= self.cut_off.iter().any(|(from, until)| (*from..*until).contains(&step));
        now
    }
}

/// Somebody who hears a link and sends on it, without its keys.
#[derive(Debug)]
pub(super) struct Attacker {
    chance: ChaCha8Rng,
    /// What the drone was told, and what it said.
    remembered: [Vec<Frame>; 2],
    /// Frames put in.
    pub(super) injected: [u64; 2],
}

/// A frame of an attacker.
#[derive(Clone, Debug)]
pub(super) struct Forgery {
    pub(super) frame: Frame,
    /// Whether somebody acts upon it rightly, however often: a hello or a question who somebody is, as it was heard.
    pub(super) is_harmless: bool,
}

/// Towards the drone.
pub(super) const DOWN: usize = 0;
/// Towards the control center.
pub(super) const UP: usize = 1;

impl Attacker {
    fn new(chance: ChaCha8Rng) -> Self {
        Self { chance, remembered: Default::default(), injected: [0; 2] }
    }

    /// A frame came to its end.
    pub(super) fn hears(&mut self, direction: usize, frame: &[u8]) {
        let remembered = &mut self.remembered[direction];
        if let Ok(frame) = Frame::from_slice(frame) {
            if remembered.len() < REMEMBERED {
                remembered.push(frame);
            } else {
                let place = self.chance.next_u32() as usize % REMEMBERED;
                remembered[place] = frame;
            }
        }
    }

    /// A frame to put in, now and then: recorded, with some bits turned, cut, longer, with another header, or nothing but noise.
    pub(super) fn frame(&mut self, direction: usize, seconds: f64) -> Option<Forgery> {
        if self.remembered[direction].is_empty() || !rng::chance(&mut self.chance, FRAMES_PER_S * seconds) {
            return None;
        }
        let mut below = |limit: usize| self.chance.next_u32() as usize % limit.max(1);
        let remembered = &self.remembered[direction];
        let heard = &remembered[below(remembered.len())];
        let mut frame = heard.clone();
        match below(6) {
            0 => {}
            1 => {
                for _ in 0..=below(8) {
                    let (at, bit) = (below(frame.len()), below(8));
                    frame[at] ^= 1 << bit;
                }
            }
            2 => frame.truncate(below(frame.len())),
            3 => {
                let more = below(MAX_FRAME - frame.len() + 1);
                (0..more).for_each(|_| frame.push(below(256) as u8).expect("there is room"));
            }
            4 => {
                let head = frame.len().min(12);
                frame[..head].iter_mut().for_each(|byte| *byte = below(256) as u8);
            }
            _ => frame.iter_mut().for_each(|byte| *byte = below(256) as u8),
        }
        self.injected[direction] += 1;
        let is_harmless = frame == *heard
            && match Header::read(heard) {
                Ok(header) => header.flags & FLAG_UNBOUND != 0,
                Err(error) => matches!(error, DecodeError::Version { found: MANAGEMENT_VERSION }),
            };
        Some(Forgery { frame, is_harmless })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_begin_and_end_when_they_should() {
        let mut scenario = Scenario::default();
        let fault = |kind, at_s, for_s| FaultTable { kind, drone: Some(2), at_s, for_s };
        scenario.faults = vec![
            fault(FaultKind::BoardReset, 1.0, 0.5),
            fault(FaultKind::ClockJump, 2.0, 0.0),
            fault(FaultKind::NavigationNan, 3.0, 1.0),
        ];
        let faults = DroneFaults::new(&scenario, 2);
        let steps =
            |what: fn(&Now) -> bool| (0..2_000).filter(|step| what(&faults.at(*step))).collect::<Vec<u64>>();
        assert_eq!(steps(|now| now.booting), (50..75).collect::<Vec<_>>());
        assert_eq!(steps(|now| now.boots), [75]);
        assert_eq!(steps(|now| now.jump_ps > 0.0), [100]);
        assert_eq!(steps(|now| now.navigation_nan), (150..200).collect::<Vec<_>>());
        assert_eq!(steps(|now| now.excused), (150..950).collect::<Vec<_>>());
        assert!((0..2_000).all(|step| DroneFaults::new(&scenario, 1).at(step) == Now::default()));
    }

    #[test]
    fn an_attacker_repeats_cuts_and_damages_what_it_heard() {
        let mut attacker = Attacker::new(rng::stream(1, Stream::Faults, 1));
        assert!(attacker.frame(DOWN, 1.0).is_none(), "it has heard nothing");
        attacker.hears(DOWN, &[7; 40]);
        let forgeries = (0..600).filter_map(|_| attacker.frame(DOWN, 1.0));
        let frames: Vec<Frame> =
            forgeries.inspect(|it| assert!(!it.is_harmless)).map(|it| it.frame).collect();
        let as_heard = frames.iter().filter(|frame| ***frame == [7; 40]).count();
        assert!(frames.len() == 600 && (60..140).contains(&as_heard), "{as_heard}");
        assert!(frames.iter().any(|frame| frame.len() < 40) && frames.iter().any(|frame| frame.len() > 40));
        assert_eq!(attacker.injected, [600, 0]);
    }
}
