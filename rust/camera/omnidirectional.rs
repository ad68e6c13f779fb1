//! Omnidirectional: a mirror or fisheye as a unit sphere, seen from xi behind its centre.
//!
//! Mei and Rives, *Single view point omnidirectional camera calibration from planar grids*, as OpenCV's omnidir and
//! KITTI-360's `image_02.yaml` have it: the point is put on the unit sphere, projected from `(0, 0, -xi)`, and distorted
//! by k1 k2 p1 p2. Focal lengths are those of the generalised camera (gamma1, gamma2). With xi = 0 it is a plumb_bob.

use nalgebra::{Matrix2x3, Vector2, Vector3};

use super::distortion::{Distortion, MAX_RADIUS, undistort, unfolded_radius};
use super::model::Model;
use crate::error::{Error, Result};

/// Largest xi: from farther behind the sphere, rays are parallel to within a degree.
const MAX_XI: f64 = 100.0;

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Omnidirectional {
    xi: f64,
    distortion: Distortion,
    /// Largest radius on the plane, before distortion.
    max_radius: f64,
    /// Cosine of the largest incidence angle.
    cos_limit: f64,
}

impl Omnidirectional {
    /// # Errors
    /// xi is negative, or far too large.
    pub fn new(xi: f64, [k1, k2, p1, p2]: [f64; 4]) -> Result<Self> {
        if !(0.0..=MAX_XI).contains(&xi) {
            return Err(Error::Input(format!(
                "camera.parameters: found xi {xi}, needed at least 0 and at most {MAX_XI}"
            )));
        }
        let distortion = Distortion([k1, k2, p1, p2, 0.0, 0.0, 0.0, 0.0]);
        // Seen from outside the sphere, what lies beyond the outline is hidden behind it.
        let outline = if xi > 1.0 { 1.0 / (xi * xi - 1.0).sqrt() } else { f64::INFINITY };
        let max_radius = unfolded_radius(|xy| distortion.jacobian(xy), outline.min(MAX_RADIUS));
        let cos_limit =
            if max_radius >= outline { -1.0 / xi } else { lift(xi, max_radius * max_radius) - xi };
        Ok(Self { xi, distortion, max_radius, cos_limit })
    }
}

impl Model for Omnidirectional {
    #[inline]
    fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        let range = point.norm();
        let seen = point.z > self.cos_limit * range;
        seen.then(|| self.distortion.at(point.xy() / (point.z + self.xi * range)))
    }

    #[inline]
    fn jacobian(&self, point: &Vector3<f64>) -> Matrix2x3<f64> {
        let range = point.norm();
        let depth = point.z + self.xi * range;
        let depth_slope = Vector3::z() + point * (self.xi / range);
        let xy = point.xy() / depth;
        self.distortion.jacobian(xy) * quotient_jacobian(xy, depth, &depth_slope)
    }

    fn unproject(&self, distorted: &Vector2<f64>) -> Option<Vector3<f64>> {
        let (at, jacobian) = (|xy| self.distortion.at(xy), |xy| self.distortion.jacobian(xy));
        let xy = undistort(at, jacobian, distorted, self.max_radius)?;
        let lift = lift(self.xi, xy.norm_squared());
        Some((xy * lift).push(lift - self.xi))
    }

    fn limit(&self) -> f64 {
        self.cos_limit.clamp(-1.0, 1.0).acos()
    }
}

/// How far from the projection centre, along a ray through a place of the plane, the unit sphere is met; `r2` is the
/// place's squared radius.
fn lift(xi: f64, r2: f64) -> f64 {
    (xi + (1.0 + (1.0 - xi * xi) * r2).max(0.0).sqrt()) / (1.0 + r2)
}

/// The Jacobian of `xy = (x, y) / depth` with respect to the point, whose depth has this gradient.
#[inline]
pub(super) fn quotient_jacobian(xy: Vector2<f64>, depth: f64, depth_slope: &Vector3<f64>) -> Matrix2x3<f64> {
    (Matrix2x3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0) - xy * depth_slope.transpose()) / depth
}
