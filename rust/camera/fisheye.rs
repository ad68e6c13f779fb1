//! Fisheye: the distorted radius is an odd polynomial of the incidence angle.
//!
//! Kannala and Brandt, *A generic camera model and calibration method for conventional, wide-angle, and fish-eye lenses*,
//! in OpenCV's form; unlike there, the angle is taken beyond 90 degrees, too.

use nalgebra::{Matrix2x3, Vector2, Vector3};

use super::model::Model;
use super::monotone::{invert_monotone, monotone_limit};
use super::radial::{MAX_ANGLE, jacobian, jacobian_on_axis, off_axis, ray};

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

    #[inline]
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
