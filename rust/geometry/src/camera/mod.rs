//! Camera models: a ray in the camera frame to a pixel, and back.
//!
//! A lens, through the interface [`Model`], maps a point to distorted coordinates, and `K` maps these to pixels.
//! Coefficients are in OpenCV's order. Pixels are `(u, v)`; an integer pixel is a pixel centre.
//!
//! A lens is valid up to the incidence angle at which its distortion stops being monotone. A point beyond it is
//! outside: it has no pixel, and never one that belongs to another direction.

mod distortion;
mod intrinsics;
mod lens;
mod model;
mod polynomial;
mod radial;
mod spheres;
#[cfg(test)]
mod tests;

use std::f64::consts::PI;
use std::sync::Arc;

use nalgebra::{Matrix2, Matrix2x3, Point2, Vector2, Vector3};

use crate::Invalid;
pub use intrinsics::{Intrinsic, IntrinsicSlopes};
use lens::Lens;
use model::Model;

/// Number of points that loops project before they use the first of them: divisions of many points overlap as long
/// as no branch has to be predicted between them.
pub const RUN: usize = 128;

/// Number of parts of each side of the image, at whose ends rays are compared to find how wide the view is.
const VIEW_RAYS: usize = 16;
/// Angle, radians, by which a ray on the border may leave the optical axis farther than those compared.
const VIEW_MARGIN: f64 = 0.05;

/// A camera: image size, `K` and lens.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Columns of the image.
    pub width: usize,
    /// Rows of the image.
    pub height: usize,
    focal: Vector2<f64>,
    /// Columns by which a pixel moves for each unit of the second distorted coordinate.
    skew: f64,
    center: Vector2<f64>,
    lens: Lens,
    /// The lens's specification: model, distortion coefficients and parameters.
    model: Arc<str>,
    distortion: Vec<f64>,
    parameters: Vec<(String, f64)>,
}

impl Camera {
    /// Builds a camera whose model needs only `K` and `distortion`: see [`Camera::with_parameters`].
    pub fn new(
        model: &str,
        size: (usize, usize),
        k: [[f64; 3]; 3],
        distortion: &[f64],
    ) -> Result<Self, Invalid> {
        Self::with_parameters(model, size, k, distortion, &[])
    }

    /// Builds a camera.
    ///
    /// | `model` | `distortion` | `parameters` |
    /// |---|---|---|
    /// | `plumb_bob` | k1 k2 p1 p2, or with k3 | |
    /// | `rational_polynomial` | k1 k2 p1 p2 k3 k4 k5 k6 | |
    /// | `thin_prism` | the same and s1 s2 s3 s4, or with tauX tauY | |
    /// | `fisheye` | k1 k2 k3 k4 on powers of the incidence angle | |
    /// | `omnidirectional` | k1 k2 p1 p2 | xi |
    /// | `equirectangular` | | |
    /// | `fov` | w | |
    /// | `double_sphere` | | xi, alpha |
    ///
    /// No coefficients are a lens without distortion, except that `fov` needs its w. Size and `K` are in pixels. The
    /// focal lengths of an equirectangular image are pixels a radian: `width / (2 pi)` for one that goes all round. Its
    /// `K` has no skew, since its columns are azimuths.
    pub fn with_parameters(
        model: &str,
        (width, height): (usize, usize),
        k: [[f64; 3]; 3],
        distortion: &[f64],
        parameters: &[(String, f64)],
    ) -> Result<Self, Invalid> {
        let mut numbers = k.iter().flatten().chain(distortion).chain(parameters.iter().map(|(_, x)| x));
        if !numbers.all(|x| x.is_finite()) || k[0][0] <= 0.0 || k[1][1] <= 0.0 {
            return Err(Invalid(
                "camera: K, distortion and parameters need finite numbers and positive focal lengths".into(),
            ));
        }
        if k[0][1] != 0.0 && model == "equirectangular" {
            return Err(Invalid("camera: found a skew in K, expected none for equirectangular".into()));
        }
        let focal = Vector2::new(k[0][0], k[1][1]);
        let center = Vector2::new(k[0][2], k[1][2]);
        let lens = Lens::new(model, distortion, parameters, (-0.5 - center.x) / focal.x)?;
        let (distortion, parameters) = (distortion.to_vec(), parameters.to_vec());
        Ok(Self {
            width,
            height,
            focal,
            skew: k[0][1],
            center,
            lens,
            model: model.into(),
            distortion,
            parameters,
        })
    }

    /// The pixel of a point (camera frame, metres); `None` where the model is not valid. The pixel may be outside
    /// the image: see [`Camera::contains`].
    #[inline(always)]
    pub fn project(&self, point: &Vector3<f64>) -> Option<Point2<f64>> {
        let distorted = self.lens.project(point)?;
        Some(Point2::from(self.scaled(&distorted) + self.center))
    }

    /// The Jacobian of the pixel of a point that projects, pixels per metre.
    #[inline]
    pub fn jacobian(&self, point: &Vector3<f64>) -> Matrix2x3<f64> {
        Matrix2::new(self.focal.x, self.skew, 0.0, self.focal.y) * self.lens.jacobian(point)
    }

    /// The unit ray (camera frame) that projects to a pixel; `None` where the lens does not reach the pixel.
    pub fn unproject(&self, pixel: &Point2<f64>) -> Option<Vector3<f64>> {
        self.lens.unproject(&self.distorted(pixel))
    }

    /// Distorted coordinates in pixels from the principal point.
    #[inline(always)]
    fn scaled(&self, distorted: &Vector2<f64>) -> Vector2<f64> {
        Vector2::new(self.focal.x * distorted.x + self.skew * distorted.y, self.focal.y * distorted.y)
    }

    /// Distorted coordinates of a pixel.
    #[inline]
    fn distorted(&self, pixel: &Point2<f64>) -> Vector2<f64> {
        let y = (pixel.y - self.center.y) / self.focal.y;
        Vector2::new((pixel.x - self.center.x - self.skew * y) / self.focal.x, y)
    }

    /// The largest incidence angle, radians, at which the model is valid.
    pub fn limit(&self) -> f64 {
        self.lens.limit()
    }

    /// Cosine of an incidence angle beyond which nothing is inside the image: -1 if that is unknown, as where the lens
    /// does not reach the border of the image, or sees straight back, so that the border need not see farthest.
    pub fn view_cosine(&self) -> f64 {
        if self.project(&-Vector3::z()).is_some() {
            return -1.0;
        }
        let (right, bottom) = (self.width as f64 - 0.5, self.height as f64 - 0.5);
        let along = |fraction: f64, end: f64| fraction * (end + 0.5) - 0.5;
        let on_border = (0..=VIEW_RAYS).map(|ray| ray as f64 / VIEW_RAYS as f64).flat_map(|fraction| {
            let (u, v) = (along(fraction, right), along(fraction, bottom));
            [[u, -0.5], [u, bottom], [-0.5, v], [right, v]]
        });
        let mut angles = on_border
            .map(|[u, v]| self.unproject(&Point2::new(u, v)).map(|ray| ray.z.clamp(-1.0, 1.0).acos()));
        let widest = angles.try_fold(0.0, |widest: f64, angle| angle.map(|angle| widest.max(angle)));
        widest.map_or(-1.0, |widest| (widest + VIEW_MARGIN).min(PI).cos())
    }

    /// Columns per radian on the optical axis. For lenses with a mirror or a sphere this differs from the focal
    /// length.
    pub fn pixels_per_radian(&self) -> f64 {
        self.jacobian(&Vector3::z())[(0, 0)]
    }

    /// Whether a pixel is inside the image, whose pixels extend half a pixel beyond their centres.
    #[inline]
    pub fn contains(&self, pixel: &Point2<f64>) -> bool {
        pixel.x >= -0.5
            && pixel.y >= -0.5
            && pixel.x < self.width as f64 - 0.5
            && pixel.y < self.height as f64 - 0.5
    }
}
