//! Tracks small enough to embed: a sample is kept only where the straight flight between its
//! neighbours would leave the tolerance, and what is kept is written as differences of integers.

use serde::Serialize;

use crate::recording::TrackSample;

/// How far, on each axis, a drawn track may run from the recorded one before rounding, metres.
const TOLERANCE_M: f64 = 0.2;
/// Time is kept to a hundredth of a second: 0.05 m of flight at 10 m/s.
const TICKS_PER_S: f64 = 100.0;
/// Positions are kept to a decimetre.
const STEPS_PER_M: f64 = 10.0;

/// A track as differences: the first entry of each column is the value, every other the step from
/// the one before. All columns have the same length.
#[derive(Debug, Default, PartialEq, Eq, Serialize)]
pub(super) struct PackedTrack {
    /// Time, hundredths of a second.
    t_cs: Vec<i64>,
    /// East, decimetres.
    e_dm: Vec<i64>,
    /// North, decimetres.
    n_dm: Vec<i64>,
    /// Up, decimetres.
    u_dm: Vec<i64>,
    /// Samples left out because they were not finite or went back in time.
    dropped: usize,
}

impl PackedTrack {
    /// Packs a track of samples in time order. Read linearly between its samples, the result stays
    /// within `TOLERANCE_M` plus rounding (0.05 m, and the flight of 5 ms) of every sample given.
    pub(super) fn new(track: &[TrackSample]) -> Self {
        let sound = sound_samples(track);
        let mut packed = Self { dropped: track.len() - sound.len(), ..Self::default() };
        let mut last = [0_i64; 4];
        for sample in simplify(&sound) {
            let [e_m, n_m, u_m] = sample.pos_enu_m;
            let now = [
                (sample.t_s * TICKS_PER_S).round() as i64,
                (e_m * STEPS_PER_M).round() as i64,
                (n_m * STEPS_PER_M).round() as i64,
                (u_m * STEPS_PER_M).round() as i64,
            ];
            let columns = [&mut packed.t_cs, &mut packed.e_dm, &mut packed.n_dm, &mut packed.u_dm];
            for ((column, now), last) in columns.into_iter().zip(now).zip(last) {
                column.push(now - last);
            }
            last = now;
        }
        packed
    }
}

/// The finite samples of a track whose times rise.
fn sound_samples(track: &[TrackSample]) -> Vec<TrackSample> {
    let mut last_s = f64::NEG_INFINITY;
    let is_sound = |sample: &&TrackSample| {
        let sound =
            sample.t_s.is_finite() && sample.pos_enu_m.iter().all(|x| x.is_finite()) && sample.t_s > last_s;
        if sound {
            last_s = sample.t_s;
        }
        sound
    };
    track.iter().filter(is_sound).copied().collect()
}

/// Keeps as few samples as one pass can: from the last kept sample, the velocities that pass every
/// later sample within the tolerance form a box (the "swinging door"); the first sample out of
/// reach of that box closes it, and the one before is kept.
fn simplify(track: &[TrackSample]) -> Vec<TrackSample> {
    let Some(&first) = track.first() else {
        return Vec::new();
    };
    let mut kept = vec![first];
    let mut anchor = first;
    let mut last = first;
    let mut door = Door::open();
    for &sample in &track[1..] {
        if !door.lets_through(&anchor, &sample) {
            kept.push(last);
            anchor = last;
            door = Door::open();
        }
        door.narrow(&anchor, &sample);
        last = sample;
    }
    if track.len() > 1 {
        kept.push(last);
    }
    kept
}

/// The velocities still allowed on each axis, metres per second.
struct Door {
    least: [f64; 3],
    most: [f64; 3],
}

impl Door {
    fn open() -> Self {
        Self { least: [f64::NEG_INFINITY; 3], most: [f64::INFINITY; 3] }
    }

    fn lets_through(&self, anchor: &TrackSample, sample: &TrackSample) -> bool {
        let dt_s = sample.t_s - anchor.t_s;
        (0..3).all(|axis| {
            let v = (sample.pos_enu_m[axis] - anchor.pos_enu_m[axis]) / dt_s;
            (self.least[axis]..=self.most[axis]).contains(&v)
        })
    }

    fn narrow(&mut self, anchor: &TrackSample, sample: &TrackSample) {
        let dt_s = sample.t_s - anchor.t_s;
        for axis in 0..3 {
            let moved_m = sample.pos_enu_m[axis] - anchor.pos_enu_m[axis];
            self.least[axis] = self.least[axis].max((moved_m - TOLERANCE_M) / dt_s);
            self.most[axis] = self.most[axis].min((moved_m + TOLERANCE_M) / dt_s);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn unpack(packed: &PackedTrack) -> Vec<TrackSample> {
        let sums = |column: &[i64], per_unit: f64| -> Vec<f64> {
            let running = column.iter().scan(0, |sum, step| {
                *sum += step;
                Some(*sum as f64 / per_unit)
            });
            running.collect()
        };
        let t = sums(&packed.t_cs, TICKS_PER_S);
        let [e, n, u] = [&packed.e_dm, &packed.n_dm, &packed.u_dm].map(|column| sums(column, STEPS_PER_M));
        (0..t.len()).map(|i| TrackSample { t_s: t[i], pos_enu_m: [e[i], n[i], u[i]] }).collect()
    }

    fn at(track: &[TrackSample], t_s: f64) -> [f64; 3] {
        let next = track.partition_point(|s| s.t_s < t_s).clamp(1, track.len() - 1);
        let (a, b) = (track[next - 1], track[next]);
        let part = ((t_s - a.t_s) / (b.t_s - a.t_s)).clamp(0.0, 1.0);
        [0, 1, 2].map(|i| a.pos_enu_m[i] + part * (b.pos_enu_m[i] - a.pos_enu_m[i]))
    }

    proptest! {
        #[test]
        fn the_packed_track_stays_within_tolerance(
            steps in prop::collection::vec((-12.0..12.0_f64, -12.0..12.0_f64, -3.0..3.0_f64, 0.05..3.0_f64), 2..200)
        ) {
            let mut sample = TrackSample { t_s: 0.0, pos_enu_m: [-4000.0, 7000.0, 300.0] };
            let mut track = vec![sample];
            for (i, (ve, vn, vu, dt_s)) in steps.into_iter().enumerate() {
                // Runs of straight flight, as missions have them, with a jump now and then.
                let jump = if i % 7 == 0 { 1.0 } else { 0.01 };
                sample.t_s += dt_s;
                for (x, v) in sample.pos_enu_m.iter_mut().zip([ve, vn, vu]) {
                    *x += v * jump * dt_s;
                }
                track.push(sample);
            }
            let packed = unpack(&PackedTrack::new(&track));
            prop_assert!(packed.len() <= track.len());
            for sample in &track {
                let drawn = at(&packed, sample.t_s);
                for (drawn_m, true_m) in drawn.iter().zip(sample.pos_enu_m) {
                    let allowed_m = TOLERANCE_M + 0.05 + 12.0 * 0.005 * 2.0;
                    prop_assert!((drawn_m - true_m).abs() <= allowed_m, "{drawn_m} for {true_m}");
                }
            }
        }
    }

    #[test]
    fn a_straight_lane_costs_two_samples() {
        let lane: Vec<_> = (0..1000)
            .map(|i| TrackSample { t_s: f64::from(i), pos_enu_m: [10.0 * f64::from(i), 500.0, 300.0] })
            .collect();
        let packed = PackedTrack::new(&lane);
        assert_eq!(packed.t_cs, [0, 99_900]);
        assert_eq!(packed.e_dm, [0, 99_900]);
        assert_eq!(packed.n_dm, [5000, 0]);
    }

    #[test]
    fn unsound_samples_are_left_out_and_counted() {
        let at = |t_s, e_m| TrackSample { t_s, pos_enu_m: [e_m, 0.0, 0.0] };
        let track = [at(0.0, 0.0), at(1.0, f64::NAN), at(2.0, 20.0), at(2.0, 21.0), at(f64::INFINITY, 5.0)];
        let packed = PackedTrack::new(&track);
        assert_eq!(packed.dropped, 3);
        assert_eq!(packed.t_cs, [0, 200]);
        assert_eq!(PackedTrack::new(&[]), PackedTrack::default());
    }
}
