//! A pinhole with OpenCV's distortion: plumb_bob and rational_polynomial with radial, rational and tangential
//! terms, and the full model with thin prism terms and a tilted sensor (Scheimpflug).

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Vector2, Vector3};

use super::distortion::{Distortion, MAX_RADIUS, undistort, unfolded_radius};
use super::model::Model;
use crate::Invalid;

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Polynomial {
    distortion: Distortion,
    is_distorted: bool,
    /// Largest radius, normalised.
    max_radius: f64,
}

impl Polynomial {
    /// k1 k2 p1 p2 k3 k4 k5 k6: plumb_bob is the case k4 = k5 = k6 = 0.
    pub fn new(coefficients: [f64; 8]) -> Self {
        let distortion = Distortion(coefficients);
        let max_radius = unfolded_radius(|xy| distortion.jacobian(xy), MAX_RADIUS);
        Self { distortion, is_distorted: !distortion.is_none(), max_radius }
    }
}

impl Model for Polynomial {
    #[inline(always)]
    fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        let normalised = normalised(point, self.max_radius)?;
        Some(if self.is_distorted { self.distortion.at(normalised) } else { normalised })
    }

    #[inline]
    fn jacobian(&self, point: &Vector3<f64>) -> Matrix2x3<f64> {
        let of_pinhole = normalised_jacobian(point);
        if self.is_distorted {
            self.distortion.jacobian(point.xy() / point.z) * of_pinhole
        } else {
            of_pinhole
        }
    }

    fn unproject(&self, distorted: &Vector2<f64>) -> Option<Vector3<f64>> {
        let (at, jacobian) = (|xy| self.distortion.at(xy), |xy| self.distortion.jacobian(xy));
        undistort(at, jacobian, distorted, self.max_radius).map(|xy| xy.push(1.0).normalize())
    }

    fn limit(&self) -> f64 {
        self.max_radius.atan()
    }
}

/// Pinhole projection, x / z and y / z, of points in front of the camera, within a radius.
#[inline]
pub(super) fn normalised(point: &Vector3<f64>, max_radius: f64) -> Option<Vector2<f64>> {
    if point.z <= 0.0 {
        return None;
    }
    let normalised = point.xy() / point.z;
    (normalised.norm_squared() <= max_radius * max_radius).then_some(normalised)
}

#[inline]
pub(super) fn normalised_jacobian(point: &Vector3<f64>) -> Matrix2x3<f64> {
    let (x, y, inverse) = (point.x / point.z, point.y / point.z, 1.0 / point.z);
    Matrix2x3::new(inverse, 0.0, -x * inverse, 0.0, inverse, -y * inverse)
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct ThinPrism {
    distortion: Distortion,
    /// s1 s2 s3 s4.
    prism: [f64; 4],
    /// The homography from the plane of the lens to that of the sensor.
    tilt: Matrix3<f64>,
    /// Largest radius, normalised.
    max_radius: f64,
}

impl ThinPrism {
    /// k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tauX tauY, the last two in radians.
    pub fn new(coefficients: [f64; 14]) -> Result<Self, Invalid> {
        let [k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tau_x, tau_y] = coefficients;
        if !(tau_x.cos() * tau_y.cos() > 0.0 && tau_x.cos() > 0.0) {
            return Err(Invalid(format!(
                "camera.distortion: found tauX {tau_x} and tauY {tau_y}, expected both within a right angle"
            )));
        }
        let mut model = Self {
            distortion: Distortion([k1, k2, p1, p2, k3, k4, k5, k6]),
            prism: [s1, s2, s3, s4],
            tilt: tilt(tau_x, tau_y),
            max_radius: MAX_RADIUS,
        };
        model.max_radius = unfolded_radius(|xy| model.plane_jacobian(xy), MAX_RADIUS);
        Ok(model)
    }

    fn at(&self, xy: Vector2<f64>) -> Vector2<f64> {
        let tilted = self.tilt * self.before_tilt(xy).push(1.0);
        tilted.xy() / tilted.z
    }

    fn before_tilt(&self, xy: Vector2<f64>) -> Vector2<f64> {
        let ([s1, s2, s3, s4], r2) = (self.prism, xy.norm_squared());
        self.distortion.at(xy) + Vector2::new(s1 + s2 * r2, s3 + s4 * r2) * r2
    }

    /// The Jacobian of [`ThinPrism::at`]; zero, as where it folds, for points that the tilted sensor cannot see.
    fn plane_jacobian(&self, xy: Vector2<f64>) -> Matrix2<f64> {
        let tilted = self.tilt * self.before_tilt(xy).push(1.0);
        if tilted.z <= 0.0 {
            return Matrix2::zeros();
        }
        let ([s1, s2, s3, s4], r2) = (self.prism, xy.norm_squared());
        let slope = Vector2::new(s1 + 2.0 * s2 * r2, s3 + 2.0 * s4 * r2);
        let before_tilt = self.distortion.jacobian(xy) + slope * xy.transpose() * 2.0;
        let homography: Matrix2x3<f64> = normalised_jacobian(&tilted) * self.tilt;
        homography.fixed_columns::<2>(0) * before_tilt
    }
}

impl Model for ThinPrism {
    fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        let normalised = normalised(point, self.max_radius)?;
        Some(self.at(normalised))
    }

    fn jacobian(&self, point: &Vector3<f64>) -> Matrix2x3<f64> {
        self.plane_jacobian(point.xy() / point.z) * normalised_jacobian(point)
    }

    fn unproject(&self, distorted: &Vector2<f64>) -> Option<Vector3<f64>> {
        let (at, jacobian) = (|xy| self.at(xy), |xy| self.plane_jacobian(xy));
        undistort(at, jacobian, distorted, self.max_radius).map(|xy| xy.push(1.0).normalize())
    }

    fn limit(&self) -> f64 {
        self.max_radius.atan()
    }
}

/// Returns the tilt of the sensor as in OpenCV: it is rotated about x, then about y, and its plane is projected
/// along the optical axis.
fn tilt(tau_x: f64, tau_y: f64) -> Matrix3<f64> {
    let ((sin_x, cos_x), (sin_y, cos_y)) = (tau_x.sin_cos(), tau_y.sin_cos());
    let about_x = Matrix3::new(1.0, 0.0, 0.0, 0.0, cos_x, sin_x, 0.0, -sin_x, cos_x);
    let about_y = Matrix3::new(cos_y, 0.0, -sin_y, 0.0, 1.0, 0.0, sin_y, 0.0, cos_y);
    let turn = about_y * about_x;
    let depth = turn[(2, 2)];
    Matrix3::new(depth, 0.0, -turn[(0, 2)], 0.0, depth, -turn[(1, 2)], 0.0, 0.0, 1.0) * turn
}
