//! The deterministic finish: Newton's method on all points, in full resolution.
//!
//! The objective is piecewise smooth with a smoothed cusp at its top, so its pointwise second derivative says nothing:
//! curvature is the difference of gradients across a block. It is taken once for each choice of visible points, and the
//! points are chosen anew at the pose that they led to.

use std::sync::Arc;

use nalgebra::{Isometry3, Matrix6, Vector6};

use super::{Counted, Level, Sample, within_baseline};
use crate::mutual_information::JointHistogram;
use crate::observation::Observations;
use crate::se3;

/// Gradients are taken so many blocks to either side, root mean square.
const HALF_WIDTH: f64 = 0.5;
/// Steps are no longer than this, in blocks.
const LONGEST_STEP: f64 = 1.0;
/// A step that does not climb is halved so many times before the search ends.
const MAX_HALVINGS: i32 = 4;
/// Curvature is taken again if the last round moved the points by more blocks than this.
const CURVATURE_HOLDS: f64 = 0.3;
/// Points that lie amid so many blocks of one class are summed up once: they hardly come to its border in a round.
const CONSTANT_RADIUS: usize = 2;
/// Directions count as curved at least by this share of the most curved one.
const LEAST_CURVATURE: f64 = 1e-3;

/// How the finish goes.
#[derive(Clone, Copy, Debug)]
pub struct PolishConfig {
    /// Side of a block of the label images, pixels.
    pub factor: usize,
    /// Pixels less than this from one of another class count little.
    pub edge_band: usize,
    /// Which points count.
    pub counted: Counted,
    /// How often the points are chosen anew.
    pub max_rounds: usize,
    /// Newton steps for each choice.
    pub max_steps: usize,
    /// Converged means that a round has moved the points by less than this many blocks, root mean square.
    pub tolerance: f64,
    /// The camera stays within this distance of the LiDAR, metres.
    pub max_baseline: f64,
}

/// Where the finish ended.
#[derive(Clone, Copy, Debug)]
pub struct Polished {
    /// `T_camera_lidar`.
    pub pose: Isometry3<f64>,
    /// Blocks by which the last round moved the points, root mean square.
    pub moved: f64,
    /// Rounds taken.
    pub rounds: usize,
}

/// Climbs to the top of the mutual information of all points.
pub fn polish(observations: &Arc<Observations>, start: &Isometry3<f64>, config: &PolishConfig) -> Polished {
    let level = Level::new(Arc::clone(observations), config.factor, config.edge_band, usize::MAX);
    let mut polished =
        Polished { pose: within_baseline(start, config.max_baseline), moved: f64::INFINITY, rounds: 0 };
    let mut inverse_curvature = Matrix6::zeros();
    for round in 1..=config.max_rounds {
        let begun = polished.pose;
        let mut samples = level.samples(&begun, config.counted);
        let constant = level.take_constant(&mut samples, &begun, CONSTANT_RADIUS);
        let Some(motions) = level.unit_motions(&samples, &begun) else { break };
        let objective = Objective { level: &level, samples, constant, motions, config };
        // In the units of the first round, which hardly differ.
        if polished.moved > CURVATURE_HOLDS {
            inverse_curvature = objective.inverse_curvature(&begun);
        }
        polished.pose = objective.newton(&begun, &inverse_curvature);
        polished.rounds = round;
        polished.moved = blocks_between(&motions, &begun, &polished.pose);
        if polished.moved < config.tolerance {
            break;
        }
    }
    polished
}

/// The mutual information of one choice of points, over motions of a pose by blocks.
struct Objective<'a> {
    level: &'a Level,
    samples: Vec<Sample>,
    /// Pairs that do not change.
    constant: JointHistogram,
    motions: Matrix6<f64>,
    config: &'a PolishConfig,
}

impl Objective<'_> {
    /// Mutual information, and its gradient with respect to the unit motions.
    fn slope(&self, pose: &Isometry3<f64>) -> (f64, Vector6<f64>) {
        let slope = self.level.slope(&self.samples, &self.constant, pose);
        (slope.joint.mutual_information(), self.motions.tr_mul(&slope.gradient))
    }

    fn moved(&self, pose: &Isometry3<f64>, by: &Vector6<f64>) -> Isometry3<f64> {
        within_baseline(&(se3::exp(&(self.motions * by)) * pose), self.config.max_baseline)
    }

    fn newton(&self, start: &Isometry3<f64>, inverse_curvature: &Matrix6<f64>) -> Isometry3<f64> {
        let mut pose = *start;
        let (mut value, mut gradient) = self.slope(start);
        for _ in 0..self.config.max_steps {
            let mut step = inverse_curvature * gradient;
            step *= (LONGEST_STEP / step.norm()).min(1.0);
            let better = (0..=MAX_HALVINGS).find_map(|halvings| {
                let shorter = step * 0.5f64.powi(halvings);
                let next = self.moved(&pose, &shorter);
                let (next_value, next_gradient) = self.slope(&next);
                (next_value > value).then_some((next, next_value, next_gradient, shorter.norm()))
            });
            let Some((next, next_value, next_gradient, length)) = better else { break };
            (pose, value, gradient) = (next, next_value, next_gradient);
            if length < self.config.tolerance {
                break;
            }
        }
        pose
    }

    /// The inverse of minus the second derivative, from gradients to both sides along each motion.
    fn inverse_curvature(&self, pose: &Isometry3<f64>) -> Matrix6<f64> {
        let column = |axis: usize| {
            let mut by = Vector6::zeros();
            by[axis] = HALF_WIDTH;
            let [before, after] = [-by, by].map(|by| self.slope(&self.moved(pose, &by)).1);
            (before - after) / (2.0 * HALF_WIDTH)
        };
        let curvature = Matrix6::from_columns(&[0, 1, 2, 3, 4, 5].map(column));
        let eigen = (0.5 * (curvature + curvature.transpose())).symmetric_eigen();
        let least = LEAST_CURVATURE * eigen.eigenvalues.amax().max(f64::MIN_POSITIVE);
        let inverse = Matrix6::from_diagonal(&eigen.eigenvalues.map(|value| 1.0 / value.abs().max(least)));
        eigen.eigenvectors * inverse * eigen.eigenvectors.transpose()
    }
}

/// How far two poses move the points apart, in blocks, root mean square.
fn blocks_between(motions: &Matrix6<f64>, a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
    let between = b * a.inverse();
    let (rho, phi) = (between.translation.vector, between.rotation.scaled_axis());
    let twist = Vector6::new(rho.x, rho.y, rho.z, phi.x, phi.y, phi.z);
    motions.try_inverse().map_or(f64::INFINITY, |inverse| (inverse * twist).norm())
}

#[cfg(test)]
mod tests {
    use super::super::tests::scene;
    use super::*;

    const CONFIG: PolishConfig = PolishConfig {
        factor: 1,
        edge_band: 0,
        counted: Counted::All,
        max_rounds: 10,
        max_steps: 8,
        tolerance: 1e-3,
        max_baseline: 1.0,
    };

    #[test]
    fn it_settles_at_the_truth_from_all_sides() {
        let observations = scene(0.0);
        for side in [-1.0, 1.0] {
            let start = se3::exp(&(Vector6::new(0.06, -0.04, 0.04, 0.012, -0.016, 0.02) * side));
            let polished = polish(&observations, &start, &CONFIG);
            let error = (polished.pose.rotation.angle(), polished.pose.translation.vector.norm());
            assert!(polished.moved < CONFIG.tolerance, "{polished:?}");
            // A third of a pixel of this small picture, from two.
            assert!(error.0 < 5e-3 && error.1 < 0.04, "{error:?}");
        }
    }

    #[test]
    fn it_never_lowers_the_information() {
        let observations = scene(0.4);
        let level = Level::new(Arc::clone(&observations), 1, 0, usize::MAX);
        let information =
            |pose: &Isometry3<f64>, samples: &[Sample]| level.joint(samples, pose).mutual_information();
        let start = se3::exp(&Vector6::new(0.05, 0.05, -0.05, 0.02, 0.02, -0.02));
        let samples = level.samples(&start, Counted::All);
        let one_round = PolishConfig { max_rounds: 1, ..CONFIG };
        let end = polish(&observations, &start, &one_round).pose;
        assert!(information(&end, &samples) > information(&start, &samples));
    }
}
