//! Lenses whose distorted radius is a function of the incidence angle alone.

use nalgebra::{Matrix2, Matrix2x3, Vector2, Vector3};

/// The largest incidence angle that such a lens is asked about: it sees behind itself, but never all round.
pub(super) const MAX_ANGLE: f64 = std::f64::consts::PI * 0.95;

/// A point that is nearer to the optical axis than this share of its depth lies on it.
const ON_AXIS: f64 = 1e-12;

/// The distance of a point from the optical axis, unless it lies on the axis in front.
#[inline]
pub(super) fn off_axis(point: &Vector3<f64>) -> Option<f64> {
    let radius = point.xy().norm();
    (radius > ON_AXIS * point.z).then_some(radius)
}

/// The Jacobian with respect to a point of its direction from the axis times the distorted radius `distorted`, which
/// grows by `(dr, dz)` with the distance `radius` from the axis and with the depth.
#[inline]
pub(super) fn jacobian(
    point: &Vector3<f64>,
    radius: f64,
    distorted: f64,
    (dr, dz): (f64, f64),
) -> Matrix2x3<f64> {
    let unit = point.xy() / radius;
    // Along the radius the distorted radius changes; across it the picture only turns.
    let along = Vector3::new(unit.x * dr, unit.y * dr, dz);
    let across = (Matrix2::identity() - unit * unit.transpose()) * (distorted / radius);
    unit * along.transpose() + across * Matrix2x3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
}

/// The Jacobian on the optical axis, where the lens is a pinhole that magnifies.
#[inline]
pub(super) fn jacobian_on_axis(point: &Vector3<f64>, magnification: f64) -> Matrix2x3<f64> {
    let scale = magnification / point.z;
    Matrix2x3::new(scale, 0.0, 0.0, 0.0, scale, 0.0)
}

/// The unit ray at an angle from the axis, in the direction of `distorted`, whose length is `radius`.
pub(super) fn ray(distorted: &Vector2<f64>, radius: f64, angle: f64) -> Vector3<f64> {
    let scale = if radius < f64::EPSILON { 0.0 } else { angle.sin() / radius };
    (distorted * scale).push(angle.cos())
}
