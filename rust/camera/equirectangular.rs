//! Equirectangular: columns are azimuths about the camera's y axis, rows are elevations.
//!
//! `u = fx azimuth + cx` with `azimuth = atan2(x, z)`, positive to the right, and `v = fy elevation + cy` with
//! `elevation = atan2(y, hypot(x, z))`, positive downwards. So the focal lengths are pixels a radian, `width / (2 pi)` for
//! a picture that goes all round, and the principal point is where z points. A turn begins at the picture's left border.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::{Matrix2x3, Vector2, Vector3};

use super::model::Model;

/// Straight up and down have every azimuth: what is nearer to them than this, radians, is outside. A hundredth of the
/// pixel of a picture of 60,000 columns.
const POLE: f64 = 1e-6;

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Equirectangular {
    /// Azimuth of the picture's left border, radians.
    left: f64,
}

impl Equirectangular {
    pub fn new(left: f64) -> Self {
        Self { left }
    }
}

impl Model for Equirectangular {
    #[inline]
    fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        let level = point.x.hypot(point.z);
        let seen = level > POLE * point.y.abs();
        let azimuth = || self.left + (point.x.atan2(point.z) - self.left).rem_euclid(TAU);
        seen.then(|| Vector2::new(azimuth(), point.y.atan2(level)))
    }

    #[inline]
    fn jacobian(&self, point: &Vector3<f64>) -> Matrix2x3<f64> {
        let (x, y, z) = (point.x, point.y, point.z);
        let (level, level2, range2) = (x.hypot(z), x * x + z * z, point.norm_squared());
        let down = -y / (level * range2);
        Matrix2x3::new(z / level2, 0.0, -x / level2, x * down, level / range2, z * down)
    }

    fn unproject(&self, distorted: &Vector2<f64>) -> Option<Vector3<f64>> {
        let (right, down) = (distorted.x - self.left, distorted.y);
        if !((0.0..TAU).contains(&right) && down.abs() < FRAC_PI_2 - POLE) {
            return None;
        }
        let ((sin, cos), (down, level)) = (distorted.x.sin_cos(), down.sin_cos());
        Some(Vector3::new(level * sin, down, level * cos))
    }

    fn limit(&self) -> f64 {
        PI
    }
}
