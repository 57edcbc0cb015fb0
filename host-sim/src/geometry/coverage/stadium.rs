//! The stadium: all points within a radius of a segment; what a disk sweeps over on a straight leg.

use super::super::{V2, polygon::Polygon};
use std::f64::consts::{FRAC_PI_2, PI};

/// All points within `radius_m` of the segment from `a` to `b`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stadium {
    /// One end of the segment, metres.
    pub a: V2,
    /// The other end, metres; may equal `a`, and the stadium is a disk.
    pub b: V2,
    /// The radius, metres. Zero or less covers nothing.
    pub radius_m: f64,
}

impl Stadium {
    /// The point of the segment nearest to `p`.
    #[must_use]
    pub fn foot(&self, p: V2) -> V2 {
        let axis = self.b - self.a;
        let length2 = axis.norm_squared();
        if length2 > 0.0 {
            self.a + axis * ((p - self.a).dot(&axis) / length2).clamp(0.0, 1.0)
        } else {
            self.a
        }
    }

    /// Distance of a point from the segment (not from the border), metres.
    #[must_use]
    pub fn axis_distance_m(&self, p: V2) -> f64 {
        (p - self.foot(p)).norm()
    }

    /// A polygon within the stadium whose border is nowhere further from the stadium's than `within_m`, anticlockwise; none where the
    /// radius is not above that.
    #[must_use]
    pub fn inscribed(&self, within_m: f64) -> Option<Polygon> {
        if !(within_m > 0.0 && self.radius_m > within_m) {
            return None;
        }
        let axis = self.b - self.a;
        let heading = axis.y.atan2(axis.x);
        // A chord over the angle t is r (1 - cos(t / 2)) within its arc.
        let step = 2.0 * (1.0 - within_m / self.radius_m).acos();
        let chords = (PI / step).ceil().max(2.0);
        let half_turn = |centre: V2, from: f64| {
            (0..=chords as usize).map(move |k| {
                let angle = from + PI * k as f64 / chords;
                centre + V2::new(angle.cos(), angle.sin()) * self.radius_m
            })
        };
        let ring = half_turn(self.b, heading - FRAC_PI_2).chain(half_turn(self.a, heading + FRAC_PI_2));
        let mut ring: Vec<V2> = ring.collect();
        ring.dedup_by(|a, b| (*a - *b).norm() < 1e-6);
        if let (Some(first), Some(last)) = (ring.first(), ring.last())
            && (first - last).norm() < 1e-6
        {
            ring.pop();
        }
        Polygon::new(&ring).ok()
    }

    /// Whether all the points lie in the stadium; for the corners of a convex shape, whether all of it does.
    #[must_use]
    pub fn contains_all(&self, points: &[V2]) -> bool {
        self.radius_m > 0.0 && points.iter().all(|&p| self.axis_distance_m(p) <= self.radius_m)
    }
}

/// Merges the legs of a track into fewer stadiums, each of which lies within the union of the legs it
/// stands for: what they cover is never more than what the track covers.
///
/// Each leg from one point to the next is taken to cover the stadium with the smaller of its two radii
/// (see [`super::overlap_disk`] for why a fleet does cover that). Legs are merged while the track strays
/// from the chord by at most `tolerance_m` and the radius varies by at most `tolerance_m`; what is lost at
/// the border is at most twice that.
///
/// # Why it is a lower bound
/// The track is connected, so it meets every line perpendicular to the chord between the chord's ends. Of
/// a chord point, the track point on its perpendicular is at most the greatest perpendicular distance `e`
/// away, and the disk of radius `r` around that track point holds the disk of radius `r - e` around the
/// chord point.
#[must_use]
pub fn stadiums_from_track(points: &[(V2, f64)], tolerance_m: f64) -> Vec<Stadium> {
    let mut merged = Vec::new();
    if let [(pos_m, radius_m)] = *points {
        merged.push(Stadium { a: pos_m, b: pos_m, radius_m });
    }
    let mut first = 0;
    while first + 1 < points.len() {
        // Double the run while it fits, then halve the step: O(log) trials of linear cost per stadium.
        let mut run = 1;
        let mut step = 1;
        let mut best = leg(&points[first..=first + 1], f64::INFINITY);
        let mut growing = true;
        while step > 0 {
            let last = first + run + step;
            let trial = points.get(first..=last).and_then(|legs| leg(legs, tolerance_m));
            if trial.is_some() {
                best = trial;
                run += step;
                step = if growing { step * 2 } else { step / 2 };
            } else {
                growing = false;
                step /= 2;
            }
        }
        merged.extend(best.filter(|s| s.radius_m > 0.0));
        first += run;
    }
    merged
}

/// One stadium within the union of all legs, if the track strays by no more than the tolerance.
fn leg(points: &[(V2, f64)], tolerance_m: f64) -> Option<Stadium> {
    let (&(a, r0), &(b, _)) = (points.first()?, points.last()?);
    let chord = Stadium { a, b, radius_m: 0.0 };
    let (mut least, mut most, mut strayed_m) = (r0, r0, 0.0_f64);
    for &(p, r) in points {
        (least, most) = (least.min(r), most.max(r));
        strayed_m = strayed_m.max(chord.axis_distance_m(p));
        if strayed_m > tolerance_m || most - least > tolerance_m {
            return None;
        }
    }
    // The distance to the segment is never less than the perpendicular one.
    Some(Stadium { a, b, radius_m: least - strayed_m })
}
