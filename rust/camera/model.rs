//! The interface of a lens.

use nalgebra::{Matrix2x3, Vector2, Vector3};

/// A lens: points (camera frame, metres) to distorted coordinates, which focal lengths and principal point make pixels.
pub(super) trait Model {
    /// `None` where the model does not hold.
    fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>>;

    /// With respect to a point that is projected.
    fn jacobian(&self, point: &Vector3<f64>) -> Matrix2x3<f64>;

    /// The unit ray; `None` where the lens does not reach.
    fn unproject(&self, distorted: &Vector2<f64>) -> Option<Vector3<f64>>;

    /// The largest incidence angle, radians, at which the model holds.
    fn limit(&self) -> f64;
}
