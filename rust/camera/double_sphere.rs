//! Double sphere: Usenko, Demmel, Cremers, *The double sphere camera model*, 2018.
//!
//! The point is put on one unit sphere, then on another that lies xi ahead of it, and projected from
//! `alpha / (1 - alpha)` behind that. With xi = alpha = 0 it is a pinhole.

use nalgebra::{Matrix2x3, Vector2, Vector3};

use super::distortion::MAX_RADIUS;
use super::model::Model;
use super::monotone::monotone_limit;
use super::omnidirectional::quotient_jacobian;
use crate::error::{Error, Result};

#[derive(Clone, Debug, PartialEq)]
pub(super) struct DoubleSphere {
    xi: f64,
    alpha: f64,
    cos_limit: f64,
}

impl DoubleSphere {
    /// # Errors
    /// xi does not lie between -1 and 1, or alpha not between 0 and 1.
    pub fn new(xi: f64, alpha: f64) -> Result<Self> {
        if !(xi > -1.0 && xi < 1.0) {
            return Err(Error::Input(format!(
                "camera.parameters: found xi {xi}, needed more than -1 and less than 1"
            )));
        }
        if !(0.0..=1.0).contains(&alpha) {
            return Err(Error::Input(format!(
                "camera.parameters: found alpha {alpha}, needed at least 0 and at most 1"
            )));
        }
        let mut model = Self { xi, alpha, cos_limit: -1.0 };
        // Equations (43) to (45); where pixels would run to infinity, the lens ends like a pinhole; and where the second
        // sphere lies far behind, pixels turn back before.
        let w1 = if alpha <= 0.5 { alpha / (1.0 - alpha) } else { (1.0 - alpha) / alpha };
        let w2 = (w1 + xi) / (2.0 * w1 * xi + xi * xi + 1.0).sqrt();
        let farthest = model.unproject(&Vector2::new(MAX_RADIUS, 0.0)).map_or(-1.0, |ray| ray.z);
        let cos_limit = (-w2).max(farthest);
        let radius = |angle: f64| {
            let (sin, cos) = angle.sin_cos();
            sin / model.depths(&Vector3::new(sin, 0.0, cos), 1.0).2
        };
        let largest = cos_limit.acos();
        let limit = monotone_limit(radius, largest);
        model.cos_limit = if limit < largest { limit.cos() } else { cos_limit };
        Ok(model)
    }

    /// Depth on the second sphere, distance from its centre, and what the plane coordinates are divided by.
    #[inline]
    fn depths(&self, point: &Vector3<f64>, range: f64) -> (f64, f64, f64) {
        let shifted = self.xi * range + point.z;
        let second = (point.xy().norm_squared() + shifted * shifted).sqrt();
        (shifted, second, self.alpha * second + (1.0 - self.alpha) * shifted)
    }
}

impl Model for DoubleSphere {
    #[inline]
    fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        let range = point.norm();
        let seen = point.z > self.cos_limit * range;
        seen.then(|| point.xy() / self.depths(point, range).2)
    }

    #[inline]
    fn jacobian(&self, point: &Vector3<f64>) -> Matrix2x3<f64> {
        let range = point.norm();
        let (shifted, second, depth) = self.depths(point, range);
        let shifted_slope = Vector3::z() + point * (self.xi / range);
        let second_slope = (point.xy().push(0.0) + shifted_slope * shifted) / second;
        let depth_slope = second_slope * self.alpha + shifted_slope * (1.0 - self.alpha);
        quotient_jacobian(point.xy() / depth, depth, &depth_slope)
    }

    fn unproject(&self, distorted: &Vector2<f64>) -> Option<Vector3<f64>> {
        let (xi, alpha, r2) = (self.xi, self.alpha, distorted.norm_squared());
        let under_root = 1.0 - (2.0 * alpha - 1.0) * r2;
        if under_root < 0.0 {
            return None;
        }
        let z = (1.0 - alpha * alpha * r2) / (alpha * under_root.sqrt() + 1.0 - alpha);
        let lift = (z * xi + (z * z + (1.0 - xi * xi) * r2).sqrt()) / (z * z + r2);
        let ray = (distorted * lift).push(lift * z - xi);
        (ray.z > self.cos_limit).then_some(ray)
    }

    fn limit(&self) -> f64 {
        self.cos_limit.clamp(-1.0, 1.0).acos()
    }
}
