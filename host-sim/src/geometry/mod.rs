//! Plane geometry in metres: east and north of a local origin.

pub mod coverage;
pub mod frame;
pub mod polygon;
pub mod region;

/// A point or a vector in the plane, metres (east, north).
pub type V2 = nalgebra::Vector2<f64>;
/// A point or a vector in space, metres (east, north, up).
pub type V3 = nalgebra::Vector3<f64>;

/// The z component of the cross product: twice the signed area spanned by `a` and `b`, positive
/// when `b` lies to the left of `a`.
#[must_use]
pub fn cross(a: V2, b: V2) -> f64 {
    a.x * b.y - a.y * b.x
}
