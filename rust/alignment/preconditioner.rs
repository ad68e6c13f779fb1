//! The preconditioner: motions in which all directions of a pose weigh alike.

use nalgebra::{Isometry3, Matrix2x6, Matrix6};

use super::level::Level;
use super::pose::to_camera;
use super::sample::Sample;

/// Number of points that suffice to measure how a twist moves the image.
pub(super) const MAX_MOTION_POINTS: usize = 5000;
/// Longest translation of a column, as a share of the median range, however little it moves the points.
const LONGEST_MOTION: f64 = 0.05;

impl Level {
    /// The preconditioner of ascents: six twists, as columns, that each move the points by one block, root mean square,
    /// independently of one another.
    ///
    /// A sideways translation and the rotation that nearly undoes it in the image become one strong and one weak motion,
    /// and an ascent goes along both at one pace instead of creeping along a valley between them. `None` where numbers
    /// overflow: nothing is a million kilometres away.
    pub fn preconditioner(&self, samples: &[Sample], pose: &Isometry3<f64>) -> Option<Matrix6<f64>> {
        let to_camera = to_camera(pose);
        let camera = &self.observations.camera;
        let mut moved = Matrix6::zeros();
        let mut ranges = Vec::new();
        let step = samples.len().div_ceil(MAX_MOTION_POINTS).max(1);
        for sample in samples.iter().step_by(step) {
            let p_camera = to_camera(&sample.position);
            if let Some((_, jacobian)) = camera.project_with_jacobian(&p_camera) {
                let mut motion = Matrix2x6::zeros();
                motion.fixed_columns_mut::<3>(0).copy_from(&jacobian);
                motion.fixed_columns_mut::<3>(3).copy_from(&(-jacobian * p_camera.cross_matrix()));
                moved += motion.tr_mul(&motion);
                ranges.push(p_camera.norm());
            }
        }
        if ranges.is_empty() {
            return None;
        }
        moved /= ranges.len() as f64 * (self.factor as f64).powi(2);
        let middle = ranges.len() / 2;
        let longest = LONGEST_MOTION * *ranges.select_nth_unstable_by(middle, f64::total_cmp).1;
        for axis in 0..3 {
            moved[(axis, axis)] += longest.powi(-2);
        }
        if !moved.iter().all(|x| x.is_finite()) {
            return None;
        }
        let eigen = moved.symmetric_eigen();
        let scale =
            eigen.eigenvalues.map(|value| 1.0 / value.max(f64::EPSILON * eigen.eigenvalues.max()).sqrt());
        Some(eigen.eigenvectors * Matrix6::from_diagonal(&scale))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use nalgebra::Vector3;

    use super::super::sample::Counted;
    use super::super::scene::scene;
    use super::*;
    use crate::se3;

    const FACTOR: usize = 4;

    #[test]
    fn its_columns_move_the_points_by_one_block_each() {
        let observations = scene(0.0);
        let level = Level::new(Arc::clone(&observations), FACTOR, 0, usize::MAX);
        let pose = Isometry3::identity();
        let samples = level.samples(&pose, Counted::All);
        let motions = level.preconditioner(&samples, &pose).expect("finite");
        const STEP: f64 = 1e-4;
        for motion in motions.column_iter() {
            let moved_pose = se3::exp(&(motion * STEP));
            let moved = to_camera(&moved_pose);
            let pixel = |p: &Vector3<f64>| observations.camera.project(p).expect("in front");
            let square = |s: &Sample| (pixel(&moved(&s.position)) - pixel(&s.position)).norm_squared();
            let mean = samples.iter().map(square).sum::<f64>() / samples.len() as f64;
            let blocks = mean.sqrt() / (STEP * level.factor as f64);
            // Less than one only where the longest translation limits it.
            assert!(blocks < 1.01 && blocks > 0.1, "{blocks}");
        }
    }
}
