//! The preconditioner: motions in which all directions of a pose weigh alike.

use nalgebra::{Isometry3, Matrix6};

use super::level::Level;
use super::sample::Sample;

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
        let at = self.at(pose);
        let mut ranges = at.ranges(samples);
        if ranges.is_empty() {
            return None;
        }
        let motions = at.mean_motions(samples) / (self.factor as f64).powi(2);
        let mut moved: Matrix6<f64> = motions.fixed_view::<6, 6>(0, 0).into_owned();
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

    use super::super::projection::Projection;
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
            let [here, moved] = [pose, se3::exp(&(motion * STEP))].map(|pose| level.at(&pose));
            let pixel = |at: &Projection, s: &Sample| at.place(s).expect("in front").1;
            let square = |s: &Sample| (pixel(&moved, s) - pixel(&here, s)).norm_squared();
            let mean = samples.iter().map(square).sum::<f64>() / samples.len() as f64;
            let blocks = mean.sqrt() / (STEP * level.factor as f64);
            // Less than one only where the longest translation limits it.
            assert!(blocks < 1.01 && blocks > 0.1, "{blocks}");
        }
    }
}
