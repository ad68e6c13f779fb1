//! Poses as the objective uses them.

use nalgebra::Isometry3;

/// The pose with the camera's centre moved to the nearest place that is within `max_baseline_m` of the LiDAR.
pub(super) fn within_baseline(pose: &Isometry3<f64>, max_baseline_m: f64) -> Isometry3<f64> {
    let scale = (max_baseline_m / pose.translation.vector.norm()).min(1.0);
    Isometry3::from_parts((pose.translation.vector * scale).into(), pose.rotation)
}
