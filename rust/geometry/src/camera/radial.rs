//! Lenses whose distorted radius is a function of the incidence angle alone.
//!
//! Fisheye: an odd polynomial of the angle. Kannala and Brandt, *A generic camera model and calibration method for
//! conventional, wide-angle, and fish-eye lenses*, in OpenCV's form; unlike OpenCV, it is also defined beyond 90
//! degrees.
//!
//! FOV, also called atan: Devernay and Faugeras, *Straight lines have to be straight*:
//! `r_d = atan(2 tan(w / 2) r_u) / w`, with the undistorted radius `r_u = tan(angle)`. With `atan2` of the distance
//! from the axis and the depth it extends beyond 90 degrees (Usenko, Demmel, Cremers, *The double sphere camera
//! model*). The single coefficient w is in radians, as in Kalibr and PTAM.

use std::f64::consts::PI;

use nalgebra::{Matrix2, Matrix2x3, Vector2, Vector3};

use super::distortion::{invert_monotone, monotone_limit};
use super::model::Model;
use crate::Invalid;

/// Largest incidence angle at which such a lens is evaluated: it sees behind itself, but never all around.
pub(super) const MAX_ANGLE: f64 = std::f64::consts::PI * 0.95;

/// A point nearer to the optical axis than this fraction of its depth is on the axis.
const ON_AXIS: f64 = 1e-12;

/// Distance of a point from the optical axis, unless it is on the axis in front.
#[inline]
pub(super) fn off_axis(point: &Vector3<f64>) -> Option<f64> {
    let radius = point.xy().norm();
    (radius > ON_AXIS * point.z).then_some(radius)
}

/// The Jacobian, with respect to a point, of its direction from the axis times the distorted radius `distorted`,
/// which changes by `(dr, dz)` with the distance `radius` from the axis and with the depth.
pub(super) fn jacobian(
    point: &Vector3<f64>,
    radius: f64,
    distorted: f64,
    (dr, dz): (f64, f64),
) -> Matrix2x3<f64> {
    let unit = point.xy() / radius;
    // Along the radius the distorted radius changes; across it the image only rotates.
    let along = Vector3::new(unit.x * dr, unit.y * dr, dz);
    let across = (Matrix2::identity() - unit * unit.transpose()) * (distorted / radius);
    unit * along.transpose() + across * Matrix2x3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
}

/// The Jacobian on the optical axis, where the lens is a pinhole with a magnification.
pub(super) fn jacobian_on_axis(point: &Vector3<f64>, magnification: f64) -> Matrix2x3<f64> {
    let scale = magnification / point.z;
    Matrix2x3::new(scale, 0.0, 0.0, 0.0, scale, 0.0)
}

/// The unit ray at an angle from the axis, in the direction of `distorted`, whose length is `radius`.
pub(super) fn ray(distorted: &Vector2<f64>, radius: f64, angle: f64) -> Vector3<f64> {
    let scale = if radius < f64::EPSILON { 0.0 } else { angle.sin() / radius };
    (distorted * scale).push(angle.cos())
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Fisheye {
    /// k1 k2 k3 k4.
    k: [f64; 4],
    max_angle: f64,
}

impl Fisheye {
    pub fn new(k: [f64; 4]) -> Self {
        Self { k, max_angle: monotone_limit(|angle| radius(&k, angle), MAX_ANGLE) }
    }
}

impl Model for Fisheye {
    #[inline]
    fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        let Some(from_axis) = off_axis(point) else {
            return (point.z > 0.0).then(|| point.xy() / point.z);
        };
        let angle = from_axis.atan2(point.z);
        (angle <= self.max_angle).then(|| point.xy() * (radius(&self.k, angle) / from_axis))
    }

    fn jacobian(&self, point: &Vector3<f64>) -> Matrix2x3<f64> {
        let Some(from_axis) = off_axis(point) else { return jacobian_on_axis(point, 1.0) };
        let (k, angle) = (&self.k, from_axis.atan2(point.z));
        let a2 = angle * angle;
        let slope = 1.0 + a2 * (3.0 * k[0] + a2 * (5.0 * k[1] + a2 * (7.0 * k[2] + a2 * 9.0 * k[3])));
        // d angle = (z dr - r dz) / range^2.
        let by_range = slope / point.norm_squared();
        jacobian(point, from_axis, radius(k, angle), (point.z * by_range, -from_axis * by_range))
    }

    fn unproject(&self, distorted: &Vector2<f64>) -> Option<Vector3<f64>> {
        let length = distorted.norm();
        let angle = invert_monotone(|angle| radius(&self.k, angle), length, self.max_angle)?;
        Some(ray(distorted, length, angle))
    }

    fn limit(&self) -> f64 {
        self.max_angle
    }
}

#[inline]
fn radius(k: &[f64; 4], angle: f64) -> f64 {
    let a2 = angle * angle;
    angle * (1.0 + a2 * (k[0] + a2 * (k[1] + a2 * (k[2] + a2 * k[3]))))
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Fov {
    w: f64,
    /// `2 tan(w / 2)`.
    tangent: f64,
}

impl Fov {
    pub fn new(w: f64) -> Result<Self, Invalid> {
        if !(w > 0.0 && w < PI) {
            return Err(Invalid(format!(
                "camera.distortion: found w {w}, needed more than 0 and less than pi"
            )));
        }
        Ok(Self { w, tangent: 2.0 * (0.5 * w).tan() })
    }
}

impl Model for Fov {
    #[inline]
    fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        let Some(from_axis) = off_axis(point) else {
            return (point.z > 0.0).then(|| point.xy() * (self.tangent / (self.w * point.z)));
        };
        let radius = (self.tangent * from_axis).atan2(point.z) / self.w;
        (from_axis.atan2(point.z) <= MAX_ANGLE).then(|| point.xy() * (radius / from_axis))
    }

    fn jacobian(&self, point: &Vector3<f64>) -> Matrix2x3<f64> {
        let Some(from_axis) = off_axis(point) else {
            return jacobian_on_axis(point, self.tangent / self.w);
        };
        let stretched = self.tangent * from_axis;
        let radius = stretched.atan2(point.z) / self.w;
        let slope = self.tangent / (self.w * (stretched * stretched + point.z * point.z));
        jacobian(point, from_axis, radius, (point.z * slope, -from_axis * slope))
    }

    fn unproject(&self, distorted: &Vector2<f64>) -> Option<Vector3<f64>> {
        let radius = distorted.norm();
        if radius * self.w >= PI {
            return None;
        }
        let (sin, cos) = (radius * self.w).sin_cos();
        let angle = (sin / self.tangent).atan2(cos);
        (angle <= MAX_ANGLE).then(|| ray(distorted, radius, angle))
    }

    fn limit(&self) -> f64 {
        MAX_ANGLE
    }
}
