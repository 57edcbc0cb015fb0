//! Local coordinates turned so that the lanes run along x.

use crate::geometry::V2;

/// A frame with its origin in the middle of a box and its x axis along the lanes.
#[derive(Clone, Copy, Debug)]
pub(super) struct SweepFrame {
    centre: V2,
    along: V2,
}

impl SweepFrame {
    pub(super) fn new([min, max]: [V2; 2], direction_rad: f64) -> Self {
        Self { centre: (min + max) / 2.0, along: V2::new(direction_rad.cos(), direction_rad.sin()) }
    }

    fn across(&self) -> V2 {
        V2::new(-self.along.y, self.along.x)
    }

    /// Local to sweep coordinates.
    pub(super) fn inward(&self, p: V2) -> V2 {
        V2::new(self.along.dot(&(p - self.centre)), self.across().dot(&(p - self.centre)))
    }

    /// Sweep to local coordinates.
    pub(super) fn outward(&self, p: V2) -> V2 {
        self.centre + self.along * p.x + self.across() * p.y
    }
}
