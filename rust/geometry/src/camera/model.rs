//! The interface of a lens.

use nalgebra::{Matrix2x3, Vector2, Vector3};

/// A lens maps points (camera frame, metres) to distorted coordinates, which focal lengths and principal point turn
/// into pixels.
pub(super) trait Model {
    /// Distorted coordinates of a point; `None` where the model is not valid.
    fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>>;

    /// Derivative of the projection with respect to the point.
    fn jacobian(&self, point: &Vector3<f64>) -> Matrix2x3<f64>;

    /// The unit ray; `None` where the lens does not reach.
    fn unproject(&self, distorted: &Vector2<f64>) -> Option<Vector3<f64>>;

    /// The largest incidence angle, radians, at which the model is valid.
    fn limit(&self) -> f64;
}
