//! Lenses that first project the point to a unit sphere.
//!
//! Equirectangular: columns are azimuths about the camera's y axis, rows are elevations.
//!
//! `u = fx azimuth + cx` with `azimuth = atan2(x, z)`, positive to the right, and `v = fy elevation + cy` with
//! `elevation = atan2(y, hypot(x, z))`, positive downwards. So the focal lengths are pixels per radian,
//! `width / (2 pi)` for a full turn, and the principal point is in the direction of z. A turn begins at the left
//! border of the image.
//!
//! Omnidirectional: Mei and Rives, *Single view point omnidirectional camera calibration from planar grids*, as in
//! OpenCV's omnidir and KITTI-360's `image_02.yaml`: the sphere is projected from `(0, 0, -xi)` and distorted by k1
//! k2 p1 p2. Focal lengths are those of the generalised camera (gamma1, gamma2). With xi = 0 it is a plumb_bob.
//!
//! Double sphere: Usenko, Demmel, Cremers, *The double sphere camera model*, 2018. The point is projected from one
//! unit sphere to another that is xi ahead of it, and then from `alpha / (1 - alpha)` behind that. With xi = alpha
//! = 0 it is a pinhole.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::{Matrix2x3, Vector2, Vector3};

use super::distortion::{Distortion, MAX_RADIUS, monotone_limit, undistort, unfolded_radius};
use super::model::Model;
use crate::Invalid;

/// Straight up and down have every azimuth: directions nearer to them than this, radians, are outside. This is a
/// hundredth of a pixel in an image of 60,000 columns.
const POLE: f64 = 1e-6;

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Equirectangular {
    /// Azimuth of the image's left border, radians.
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
    pub fn new(xi: f64, [k1, k2, p1, p2]: [f64; 4]) -> Result<Self, Invalid> {
        if !(0.0..=MAX_XI).contains(&xi) {
            return Err(Invalid(format!(
                "camera.parameters: found xi {xi}, needed at least 0 and at most {MAX_XI}"
            )));
        }
        let distortion = Distortion([k1, k2, p1, p2, 0.0, 0.0, 0.0, 0.0]);
        // Seen from outside the sphere, points beyond the outline are hidden behind it.
        let outline = if xi > 1.0 { 1.0 / (xi * xi - 1.0).sqrt() } else { f64::INFINITY };
        let max_radius = unfolded_radius(|xy| distortion.jacobian(xy), outline.min(MAX_RADIUS));
        let cos_limit =
            if max_radius >= outline { -1.0 / xi } else { lift(xi, max_radius * max_radius) - xi };
        Ok(Self { xi, distortion, max_radius, cos_limit })
    }
}

impl Model for Omnidirectional {
    fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        let range = point.norm();
        let seen = point.z > self.cos_limit * range;
        seen.then(|| self.distortion.at(point.xy() / (point.z + self.xi * range)))
    }

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

/// Distance from the projection centre to the unit sphere, along the ray through a point of the plane with squared
/// radius `r2`.
#[inline]
fn lift(xi: f64, r2: f64) -> f64 {
    (xi + (1.0 + (1.0 - xi * xi) * r2).max(0.0).sqrt()) / (1.0 + r2)
}

/// The Jacobian of `xy = (x, y) / depth` with respect to the point, whose depth has this gradient.
pub(super) fn quotient_jacobian(xy: Vector2<f64>, depth: f64, depth_slope: &Vector3<f64>) -> Matrix2x3<f64> {
    (Matrix2x3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0) - xy * depth_slope.transpose()) / depth
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct DoubleSphere {
    xi: f64,
    alpha: f64,
    cos_limit: f64,
}

impl DoubleSphere {
    pub fn new(xi: f64, alpha: f64) -> Result<Self, Invalid> {
        if !(xi > -1.0 && xi < 1.0) {
            return Err(Invalid(format!(
                "camera.parameters: found xi {xi}, needed more than -1 and less than 1"
            )));
        }
        if !(0.0..=1.0).contains(&alpha) {
            return Err(Invalid(format!(
                "camera.parameters: found alpha {alpha}, needed at least 0 and at most 1"
            )));
        }
        let mut model = Self { xi, alpha, cos_limit: -1.0 };
        // Equations (43) to (45). Where pixels would run to infinity, the lens ends like a pinhole; where the
        // second sphere is far behind, pixels turn back before.
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

    /// Depth on the second sphere, distance from its centre, and divisor of the plane coordinates.
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
