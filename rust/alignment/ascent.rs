//! Gradient ascent over mini-batches, level by level, which converges from far away.

use std::sync::Arc;

use geometry::se3;
use nalgebra::{Isometry3, Vector6};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::level::Level;
use super::objective::Objective;
use super::sample::Counted;
use super::selection::in_view;
use super::variables::within_baseline;
use crate::observation::Observations;

/// Decay rates of Adam's two moments (Kingma and Ba, arXiv 1412.6980).
const ADAM_DECAY: (f64, f64) = (0.9, 0.99);
const ADAM_EPSILON: f64 = 1e-12;
/// With fewer points than this, a level is skipped and the pose stays as it is.
const MIN_POINTS: usize = 50;

/// Settings of the ascent: the fields of `AlignmentConfig` in Python, which documents them.
#[derive(Clone, Copy, Debug)]
pub struct AlignmentConfig {
    pub steps: usize,
    pub batch_size: usize,
    pub step_size: f64,
    pub final_step: f64,
    pub max_points: usize,
}

#[derive(Clone, Copy, Debug)]
pub struct Ascended {
    pub pose: Isometry3<f64>,
    /// Distance (blocks) between the mean positions in the last two quarters of the ascent. It is small after
    /// convergence. Steps count in full even where the maximum baseline prevents them.
    pub drift: f64,
    /// Number of labelled points on labelled blocks at the start, from which batches were drawn.
    pub num_points: usize,
}

/// Ascends the mutual information of all frames from a pose, on blocks of `factor` pixels.
pub fn ascend(
    observations: &Arc<Observations>,
    start: &Isometry3<f64>,
    factor: usize,
    counted: Counted,
    config: &AlignmentConfig,
    seed: u64,
) -> Ascended {
    let level = Level::new(in_view(observations, &[*start]), &[*start], factor, config.max_points);
    level.ascend(start, counted, config, seed)
}

/// Ascends an objective from each of the poses. Returns each end with the number of points there and the value of
/// the objective.
pub fn align(
    observations: &Arc<Observations>,
    starts: &[Isometry3<f64>],
    factor: usize,
    counted: Counted,
    objective: Objective,
    config: &AlignmentConfig,
    seed: u64,
) -> Vec<(Ascended, f64)> {
    let level = Level::new(in_view(observations, starts), starts, factor, config.max_points);
    let level = Level { objective, ..level };
    let align = |start| {
        let end = level.ascend(start, counted, config, seed);
        let (joint, num_points) = level.joint_at(&end.pose, counted);
        (Ascended { num_points, ..end }, level.score(&joint))
    };
    starts.par_iter().map(align).collect()
}

impl Level {
    fn ascend(
        &self,
        start: &Isometry3<f64>,
        counted: Counted,
        config: &AlignmentConfig,
        seed: u64,
    ) -> Ascended {
        let max_baseline_m = self.observations.max_baseline_m;
        let mut pose = within_baseline(start, max_baseline_m);
        if config.steps == 0 {
            return Ascended { pose, drift: 0.0, num_points: 0 };
        }
        let mut samples = self.samples(&pose, counted);
        let num_points = samples.len();
        if num_points < MIN_POINTS {
            return Ascended { pose, drift: 0.0, num_points };
        }
        // Batches are of equal or nearly equal size: a last one of a handful of points would be noise.
        let num_batches = num_points.div_ceil(config.batch_size);
        // Segments are counted frame by frame, which is fast while the points of a frame stay together.
        if num_batches > 1 || !self.observations.has_partitions() {
            samples.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
        }
        let mut batches = samples.chunks(num_points.div_ceil(num_batches)).cycle();
        let Some(preconditioner) = self.preconditioner(&samples, &pose) else {
            return Ascended { pose, drift: f64::INFINITY, num_points };
        };
        let constant = self.empty_joint();
        let mut adam = Adam::default();
        // The path so far in the preconditioner's coordinates, and its sums over the last two quarters.
        let (mut path, mut sums) = (Vector6::zeros(), [Vector6::zeros(); 2]);
        let quarter = config.steps / 4;
        for step in 0..config.steps {
            let Some(batch) = batches.next() else { break };
            let (_, gradient) = self.joint_and_gradient(batch, &constant, &self.projection(&pose));
            let cosine = 0.5 * (1.0 + (std::f64::consts::PI * step as f64 / config.steps as f64).cos());
            let length = config.step_size * (config.final_step + (1.0 - config.final_step) * cosine);
            let by = adam.step(&preconditioner.tr_mul(&gradient.fixed_rows::<6>(0))) * length;
            pose = within_baseline(&(se3::exp(&(preconditioner * by)) * pose), max_baseline_m);
            path += by;
            match config.steps - step {
                left if left <= quarter => sums[1] += path,
                left if left <= 2 * quarter => sums[0] += path,
                _ => {}
            }
        }
        Ascended { pose, drift: (sums[1] - sums[0]).norm() / quarter.max(1) as f64, num_points }
    }
}

/// Adam: steps of about unit length along a noisy gradient.
#[derive(Default)]
struct Adam {
    mean: Vector6<f64>,
    square: Vector6<f64>,
    steps: i32,
}

impl Adam {
    fn step(&mut self, gradient: &Vector6<f64>) -> Vector6<f64> {
        let (mean_decay, square_decay) = ADAM_DECAY;
        self.steps += 1;
        self.mean = self.mean * mean_decay + gradient * (1.0 - mean_decay);
        self.square = self.square * square_decay + gradient.component_mul(gradient) * (1.0 - square_decay);
        let mean = self.mean / (1.0 - mean_decay.powi(self.steps));
        let square = self.square / (1.0 - square_decay.powi(self.steps));
        mean.zip_map(&square, |m, s| m / (s.sqrt() + ADAM_EPSILON))
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_scene::scene;
    use super::*;

    const CONFIG: AlignmentConfig =
        AlignmentConfig { steps: 60, batch_size: 500, step_size: 0.2, final_step: 0.05, max_points: 10_000 };

    #[test]
    fn the_camera_stays_within_the_baseline() {
        let mut observations = (*scene(0.0)).clone();
        observations.max_baseline_m = 0.1;
        let start = Isometry3::translation(0.3, 0.0, 0.0);
        let pose =
            align(&Arc::new(observations), &[start], 4, Counted::All, Objective::Information, &CONFIG, 0)[0]
                .0
                .pose;
        assert!(pose.translation.vector.norm() <= 0.1 + 1e-12);
    }
}
