//! What is measured while the drones fly, from their true positions: separation, formation, coverage.

use crate::geometry::{
    V2, V3,
    coverage::{Stadium, overlap_disk, stadiums_from_track},
};
use skyroost_firmware::guidance::{
    formation::Slot,
    lanes::{ALONG_ACCEL_MPS2, Cursor, LATERAL_ACCEL_MPS2, Lanes},
};
use std::{
    cmp::Reverse,
    collections::{BinaryHeap, binary_heap::PeekMut},
};

/// Least separation over continuous time, pair by pair.
///
/// A pair that is far apart cannot come near for a while: it is looked at again only when the two,
/// flying at each other at the greatest speed, could have come nearer than anything seen so far. Those that are far apart
/// wait in a heap and cost nothing; the others are gone through, which is cheaper for few.
pub(super) struct Separation {
    d_safe_m: f64,
    closing_mps: f64,
    least_m: f64,
    violations: u32,
    /// Pairs to look at soon.
    near: Vec<Pair>,
    /// All others, the next to look at on top.
    far: BinaryHeap<Reverse<Pair>>,
    last_m: Vec<V3>,
    /// Drones whose separation nobody claims, now.
    excused: Vec<bool>,
}

/// Two drones.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Pair {
    /// When to look again, milliseconds.
    look_ms: u64,
    drones: [u16; 2],
    /// Whether they are too near now.
    violates: bool,
}

/// Pairs to be looked at within this time count as near, milliseconds.
const SOON_MS: u64 = 1_000;

impl Separation {
    pub(super) fn new(positions_m: &[V3], d_safe_m: f64, max_speed_mps: f64) -> Self {
        let drones = 0..positions_m.len() as u16;
        let pairs = drones.clone().flat_map(|a| {
            let others = drones.clone().skip(usize::from(a) + 1);
            others.map(move |b| Reverse(Pair { look_ms: 0, drones: [a, b], violates: false }))
        });
        Self {
            d_safe_m,
            closing_mps: 2.0 * max_speed_mps + 1.0,
            least_m: f64::INFINITY,
            violations: 0,
            near: Vec::new(),
            far: pairs.collect(),
            last_m: positions_m.to_vec(),
            excused: vec![false; positions_m.len()],
        }
    }

    /// From now on it is not looked at how near others come to this drone, or it is again.
    pub(super) fn excuse(&mut self, drone: usize, excused: bool) {
        self.excused[drone] = excused;
    }

    /// The drones moved straight from where they were to `positions_m`, where they are at `t_s`.
    pub(super) fn moved(&mut self, t_s: f64, positions_m: &[V3]) {
        let now_ms = (t_s * 1e3).round() as u64;
        while let Some(soon) = self.far.peek_mut().filter(|next| next.0.look_ms <= now_ms) {
            self.near.push(PeekMut::pop(soon).0);
        }
        let Self { near, far, least_m, violations, excused, .. } = self;
        near.retain_mut(|pair| {
            if now_ms < pair.look_ms {
                return true;
            }
            let [a, b] = pair.drones.map(usize::from);
            let after = positions_m[a] - positions_m[b];
            if excused[a] || excused[b] {
                return true;
            }
            let distance_m = least_between(self.last_m[a] - self.last_m[b], after);
            *least_m = least_m.min(distance_m);
            let violates = distance_m < self.d_safe_m;
            *violations += u32::from(violates && !pair.violates);
            pair.violates = violates;
            let spare_m = after.norm() - least_m.max(self.d_safe_m);
            pair.look_ms = now_ms + (1e3 * spare_m / self.closing_mps).max(1.0) as u64;
            let is_near = pair.look_ms < now_ms + SOON_MS;
            if !is_near {
                far.push(Reverse(*pair));
            }
            is_near
        });
        self.last_m.copy_from_slice(positions_m);
    }

    /// Least distance seen; none with fewer than two drones.
    pub(super) fn least_m(&self) -> Option<f64> {
        self.least_m.is_finite().then_some(self.least_m)
    }

    /// Times that a pair came nearer than `d_safe`.
    pub(super) fn violations(&self) -> u32 {
        self.violations
    }
}

/// Least length of a vector that moves straight from `before` to `after`.
fn least_between(before: V3, after: V3) -> f64 {
    let way = after - before;
    let length_squared = way.norm_squared();
    let share = if length_squared > 0.0 { (-before.dot(&way) / length_squared).clamp(0.0, 1.0) } else { 0.0 };
    (before + way * share).norm()
}

/// One fleet on its lanes.
pub(super) struct FleetWatch {
    lanes: Lanes,
    slots: [Slot; 3],
    altitude_m: f64,
    radius_m: f64,
    /// Way along the lanes where the transit ends.
    lanes_from_um: i64,
    phase_um: i64,
    cursor: Cursor,
    began_s: Option<f64>,
    ended_s: Option<f64>,
    squares_m2: f64,
    samples: u64,
    max_m: f64,
    /// When the fleet is or was back in formation after the last manoeuvre.
    formed_s: f64,
    manoeuvres_s: f64,
    last_s: f64,
    track: Vec<(V2, f64)>,
    next_track_s: f64,
}

/// After a manoeuvre a fleet comes back to its lane at 3 m/s, from as far as its circle and a separation.
const FORM_AGAIN_S: f64 = 15.0;

/// The track for the proof of coverage is sampled this often; see [`FleetWatch::stadiums`].
const TRACK_EVERY_S: f64 = 0.24;

impl FleetWatch {
    pub(super) fn new(
        lanes: Lanes,
        lanes_from_um: i64,
        slots: [Slot; 3],
        altitude_m: f64,
        radius_m: f64,
    ) -> Self {
        Self {
            lanes,
            slots,
            altitude_m,
            radius_m,
            lanes_from_um,
            phase_um: 0,
            cursor: Cursor::default(),
            began_s: None,
            ended_s: None,
            squares_m2: 0.0,
            samples: 0,
            max_m: 0.0,
            formed_s: 0.0,
            manoeuvres_s: 0.0,
            last_s: 0.0,
            track: Vec::new(),
            next_track_s: 0.0,
        }
    }

    /// Whether its lanes are flown.
    pub(super) fn has_ended(&self) -> bool {
        self.ended_s.is_some()
    }

    /// True positions of the three drones, by slot, at `t_s` while the fleet sweeps, and whether one of them avoids
    /// somebody.
    pub(super) fn sweeping(&mut self, t_s: f64, pos_m: [V3; 3], avoiding: bool) {
        if self.ended_s.is_some() {
            return;
        }
        let centroid = (pos_m[0] + pos_m[1] + pos_m[2]) / 3.0;
        // The fleet's phase is where its centroid stands along the track; it runs on by what the
        // centroid is ahead.
        for _ in 0..2 {
            let Some(point) = self.lanes.at(self.phase_um, &mut self.cursor) else { return };
            let ahead = centroid.xy() - point.pos_m.map(f64::from);
            let ahead_m = ahead.dot(&point.along.map(f64::from));
            self.phase_um = (self.phase_um + (ahead_m * 1e6) as i64).clamp(0, self.lanes.length_um());
        }
        let Some(point) = self.lanes.at(self.phase_um, &mut self.cursor) else { return };
        let on_lanes = self.phase_um >= self.lanes_from_um;
        if avoiding {
            self.formed_s = t_s + FORM_AGAIN_S;
        }
        let in_formation = t_s >= self.formed_s;
        if on_lanes && !in_formation && self.last_s > 0.0 {
            self.manoeuvres_s += t_s - self.last_s;
        }
        self.last_s = t_s;
        for (slot, pos) in self.slots.iter().zip(&pos_m).filter(|_| on_lanes && in_formation) {
            let place = slot.reference(&point, 0.0, 0.0, self.altitude_m as f32).pos_enu_m.map(f64::from);
            let error_m = (pos - place).norm();
            self.squares_m2 += error_m * error_m;
            self.samples += 1;
            self.max_m = self.max_m.max(error_m);
        }
        if on_lanes {
            self.began_s.get_or_insert(t_s);
        }
        // Half a metre from the end the drones hold; what remains is creep.
        if self.phase_um >= self.lanes.length_um() - 500_000 {
            self.ended_s = Some(t_s);
        }
        if t_s >= self.next_track_s || self.ended_s.is_some() {
            self.next_track_s = t_s + TRACK_EVERY_S - 1e-6;
            self.track.push(overlap_disk(pos_m.map(|p| p.xy()), self.radius_m));
        }
    }

    /// What the overlap region swept, as a lower bound: between two samples the true track is at most
    /// `a t^2 / 8` from the straight line.
    pub(super) fn stadiums(&self) -> Vec<Stadium> {
        let accel = f64::from(ALONG_ACCEL_MPS2.hypot(LATERAL_ACCEL_MPS2)) + 3.0; // and gusts
        let sagitta_m = accel * TRACK_EVERY_S * TRACK_EVERY_S / 8.0;
        let track: Vec<(V2, f64)> = self.track.iter().map(|&(c, r)| (c, r - sagitta_m)).collect();
        stadiums_from_track(&track, 0.05)
    }

    /// When its first lane began and its last one ended, seconds; none for what did not.
    pub(super) fn began_and_ended_s(&self) -> (Option<f64>, Option<f64>) {
        (self.began_s, self.ended_s)
    }

    /// Sum of squared formation errors and their number.
    pub(super) fn errors(&self) -> (f64, u64) {
        (self.squares_m2, self.samples)
    }

    /// How long the fleet avoided somebody on its lanes or came back from that, seconds.
    pub(super) fn manoeuvres_s(&self) -> f64 {
        self.manoeuvres_s
    }

    /// Greatest formation error, metres.
    pub(super) fn max_error_m(&self) -> f64 {
        self.max_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_near_pass_between_two_samples_is_seen() {
        let at = |x: f64| vec![V3::new(x, 3.0, 0.0), V3::zeros()];
        let mut watch = Separation::new(&at(-5.0), 10.0, 10.0);
        watch.moved(1.0, &at(5.0));
        assert!((watch.least_m().unwrap() - 3.0).abs() < 1e-12);
        watch.moved(2.0, &at(15.0));
        watch.moved(3.0, &at(25.0));
        watch.moved(4.0, &at(5.0));
        assert_eq!(watch.violations(), 2, "two encounters");
    }

    #[test]
    fn looking_away_misses_nothing() {
        // Two drones on a collision course from 1 km, one step at a time.
        let at = |t: f64| vec![V3::new(10.0 * t, 0.0, 0.0), V3::new(1_000.0 - 10.0 * t, 2.0, 0.0)];
        let mut watch = Separation::new(&at(0.0), 10.0, 10.0);
        for step in 1..=5_000 {
            watch.moved(f64::from(step) * 0.02, &at(f64::from(step) * 0.02));
        }
        assert!((watch.least_m().unwrap() - 2.0).abs() < 1e-9);
        assert_eq!(watch.violations(), 1);
    }
}
