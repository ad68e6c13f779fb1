//! FOV, also called atan: Devernay and Faugeras, *Straight lines have to be straight*.
//!
//! `r_d = atan(2 tan(w / 2) r_u) / w`, with the undistorted radius `r_u = tan(angle)`. With `atan2` of distance from the
//! axis and depth it goes on beyond 90 degrees (Usenko, Demmel, Cremers, *The double sphere camera model*). The one
//! coefficient w is in radians, as Kalibr and PTAM write it.

use std::f64::consts::PI;

use nalgebra::{Matrix2x3, Vector2, Vector3};

use super::model::Model;
use super::radial::{MAX_ANGLE, jacobian, jacobian_on_axis, off_axis, ray};
use crate::error::{Error, Result};

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Fov {
    w: f64,
    /// `2 tan(w / 2)`.
    tangent: f64,
}

impl Fov {
    /// # Errors
    /// w is not an angle between 0 and pi.
    pub fn new(w: f64) -> Result<Self> {
        if !(w > 0.0 && w < PI) {
            return Err(Error::Input(format!(
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

    #[inline]
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
