//! Lenses whose distorted radius is a function of the incidence angle alone.

use nalgebra::{Matrix2, Matrix2x3, Vector2, Vector3};

use super::distortion::NEWTON_TOLERANCE;

/// The largest incidence angle that such a lens is asked about: it sees behind itself, but never all round.
pub(super) const MAX_ANGLE: f64 = std::f64::consts::PI * 0.95;
/// Samples of the angle on which the radius is checked to be monotone.
const MONOTONE_STEPS: usize = 4096;

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

/// Bisection for `f(x) = y` on `[0, limit]`, where `f` grows.
pub(super) fn invert_monotone(f: impl Fn(f64) -> f64, y: f64, limit: f64) -> Option<f64> {
    (y <= f(limit)).then_some(())?;
    let (mut low, mut high) = (0.0, limit);
    while high - low > NEWTON_TOLERANCE {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if f(middle) < y {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(0.5 * (low + high))
}

/// The angle at which a radius stops growing, at most `largest`: beyond it pixels would wrap.
pub(super) fn monotone_limit(radius: impl Fn(f64) -> f64, largest: f64) -> f64 {
    let at = |step: usize| largest * step as f64 / MONOTONE_STEPS as f64;
    let grows = |step: usize| radius(at(step)) > radius(at(step - 1));
    (1..=MONOTONE_STEPS).find(|&step| !grows(step)).map_or(largest, |step| at(step - 1))
}
