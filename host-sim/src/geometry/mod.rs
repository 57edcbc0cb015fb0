//! Plane geometry in metres: east and north of a local origin.

/// A point or a vector in the plane, metres (east, north).
pub type V2 = nalgebra::Vector2<f64>;
/// A point or a vector in space, metres (east, north, up).
pub type V3 = nalgebra::Vector3<f64>;
