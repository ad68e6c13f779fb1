//! Poses as the objective uses them.

use nalgebra::{Isometry3, Vector3};

/// Maps points from the LiDAR frame to the camera frame.
pub(super) fn to_camera(pose: &Isometry3<f64>) -> impl Fn(&Vector3<f64>) -> Vector3<f64> + use<> {
    let (rotation, translation) = (*pose.rotation.to_rotation_matrix().matrix(), pose.translation.vector);
    move |point| rotation * point + translation
}

/// The pose with the camera's centre moved to the nearest place that is within `max_baseline_m` of the LiDAR.
pub(super) fn within_baseline(pose: &Isometry3<f64>, max_baseline_m: f64) -> Isometry3<f64> {
    let scale = (max_baseline_m / pose.translation.vector.norm()).min(1.0);
    Isometry3::from_parts((pose.translation.vector * scale).into(), pose.rotation)
}
