//! plumb_bob and rational_polynomial: a pinhole with OpenCV's radial, rational and tangential terms.

use nalgebra::{Matrix2x3, Vector2, Vector3};

use super::distortion::{Distortion, MAX_RADIUS, undistort, unfolded_radius};
use super::model::Model;

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Polynomial {
    distortion: Distortion,
    /// Normalised.
    max_radius: f64,
}

impl Polynomial {
    /// k1 k2 p1 p2 k3 k4 k5 k6: plumb_bob is the case k4 = k5 = k6 = 0.
    pub fn new(coefficients: [f64; 8]) -> Self {
        let distortion = Distortion(coefficients);
        let max_radius = unfolded_radius(|xy| distortion.jacobian(xy), MAX_RADIUS);
        Self { distortion, max_radius }
    }
}

impl Model for Polynomial {
    #[inline(always)]
    fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        let normalised = normalised(point, self.max_radius)?;
        Some(self.distortion.at(normalised))
    }

    #[inline]
    fn jacobian(&self, point: &Vector3<f64>) -> Matrix2x3<f64> {
        self.distortion.jacobian(point.xy() / point.z) * normalised_jacobian(point)
    }

    fn unproject(&self, distorted: &Vector2<f64>) -> Option<Vector3<f64>> {
        let (at, jacobian) = (|xy| self.distortion.at(xy), |xy| self.distortion.jacobian(xy));
        undistort(at, jacobian, distorted, self.max_radius).map(|xy| xy.push(1.0).normalize())
    }

    fn limit(&self) -> f64 {
        self.max_radius.atan()
    }
}

/// The pinhole: x / z and y / z of what lies in front, within a radius.
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
