//! The deterministic finish: Newton's method on all points, in full resolution.
//!
//! The objective is piecewise smooth with a smoothed cusp at its top, so its pointwise second derivative says nothing:
//! curvature is the difference of gradients across a block. It is taken once for each choice of visible points, and the
//! points are chosen anew at the pose that they led to.

use std::sync::Arc;

use nalgebra::{Isometry3, Matrix6, Vector6};

use super::choice::Chosen;
use super::level::Level;
use super::pose::within_baseline;
use super::sample::{Counted, Sample};
use super::view::in_view;
use crate::mutual_information::JointHistogram;
use crate::observation::Observations;
use crate::se3;

/// Blocks are pixels.
const FACTOR: usize = 1;
/// Distance in blocks to either side at which gradients are taken, root mean square.
const HALF_WIDTH: f64 = 0.5;
/// Steps are no longer than this, in blocks.
const LONGEST_STEP: f64 = 1.0;
/// A step that does not ascend is halved at most this number of times before the search ends.
const MAX_HALVINGS: i32 = 4;
/// Curvature is taken again if the last round moved the points by more blocks than this.
const CURVATURE_HOLDS: f64 = 0.3;
/// Points at least this number of blocks inside one class are summed up once. A round that moves them farther is
/// followed by another one, which chooses them again.
const CONSTANT_RADIUS: usize = 2;
/// Directions count as curved at least by this share of the most curved one.
const LEAST_CURVATURE: f64 = 1e-3;

/// Settings of the polish.
#[derive(Clone, Copy, Debug)]
pub struct PolishConfig {
    /// Pixels less than this from one of another class count little.
    pub edge_band_px: usize,
    /// Largest number of times that the points are chosen.
    pub max_rounds: usize,
    /// Largest number of Newton steps for each choice of points.
    pub max_steps: usize,
    /// The polish has converged when a round moves the points by less than this, root mean square.
    pub tolerance_px: f64,
    /// The camera stays within this distance of the LiDAR, metres.
    pub max_baseline_m: f64,
}

/// The result of the polish.
#[derive(Clone, Copy, Debug)]
pub struct Polished {
    /// `T_camera_lidar`.
    pub pose: Isometry3<f64>,
    /// Distance by which the last round moved the points, or still tried to move them, root mean square.
    pub moved_px: f64,
    /// Last computed inverse of minus the second derivative with respect to a twist; `None` where nothing changes the
    /// information.
    pub inverse_curvature: Option<Matrix6<f64>>,
}

/// Ascends to the maximum of the mutual information of all points. `inverse_curvature` is that of a nearby polish on part
/// of the data; with it the curvature need not be computed at the start.
pub fn polish(
    observations: &Arc<Observations>,
    start: &Isometry3<f64>,
    inverse_curvature: Option<&Matrix6<f64>>,
    counted: Counted,
    config: &PolishConfig,
) -> Polished {
    let level = Level::new(in_view(observations, &[*start]), FACTOR, config.edge_band_px, usize::MAX);
    let start = within_baseline(start, config.max_baseline_m);
    // The curvature is with respect to twists, so that it outlives the motions of a round.
    let mut is_stale = inverse_curvature.is_none();
    let inverse_curvature = inverse_curvature.copied();
    let mut polished = Polished { pose: start, moved_px: f64::INFINITY, inverse_curvature };
    for _ in 0..config.max_rounds {
        let begun = polished.pose;
        let Chosen { moving: samples, constant } = level.chosen(&begun, counted, CONSTANT_RADIUS);
        let Some(preconditioner) = level.preconditioner(&samples, &begun) else { break };
        let objective = Objective { level: &level, samples, constant, preconditioner, config };
        let is_fresh = is_stale;
        if is_stale {
            polished.inverse_curvature = objective.inverse_curvature(&begun);
        }
        let Some(inverse_curvature) = polished.inverse_curvature else { break };
        let (pose, wanted) = objective.newton(&begun, &inverse_curvature);
        let gone = objective.blocks_between(&begun, &pose);
        polished = Polished { pose, moved_px: gone.max(wanted), ..polished };
        // A step that gained nothing may be that of an old curvature, or a cusp is the top.
        if gone < config.tolerance_px && (wanted < config.tolerance_px || is_fresh) {
            break;
        }
        is_stale = gone > CURVATURE_HOLDS || wanted >= config.tolerance_px;
    }
    polished
}

/// The mutual information of one choice of points.
struct Objective<'a> {
    level: &'a Level,
    samples: Vec<Sample>,
    /// Pairs that do not change.
    constant: JointHistogram,
    /// Twists, as columns, that each move the points by one block.
    preconditioner: Matrix6<f64>,
    config: &'a PolishConfig,
}

impl Objective<'_> {
    /// Mutual information, and its gradient with respect to a twist.
    fn value_and_gradient(&self, pose: &Isometry3<f64>) -> (f64, Vector6<f64>) {
        let (joint, gradient) = self.level.joint_and_gradient(&self.samples, &self.constant, pose);
        (self.level.information(&joint), gradient)
    }

    fn moved(&self, pose: &Isometry3<f64>, twist: &Vector6<f64>) -> Isometry3<f64> {
        within_baseline(&(se3::exp(twist) * pose), self.config.max_baseline_m)
    }

    /// The pose at which Newton's method ends, and the number of blocks by which it still tried to move on: steps without
    /// a gain mean that the curvature is wrong, or that the maximum is a cusp.
    fn newton(&self, start: &Isometry3<f64>, inverse_curvature: &Matrix6<f64>) -> (Isometry3<f64>, f64) {
        let mut pose = *start;
        let (mut value, mut gradient) = self.value_and_gradient(start);
        for _ in 0..self.config.max_steps {
            let mut twist = inverse_curvature * gradient;
            let length = self.blocks(&twist);
            if !length.is_finite() {
                return (pose, f64::INFINITY);
            }
            twist *= (LONGEST_STEP / length).min(1.0);
            let better = (0..=MAX_HALVINGS).find_map(|halvings| {
                let shorter = twist * 0.5f64.powi(halvings);
                let next = self.moved(&pose, &shorter);
                let (next_value, next_gradient) = self.value_and_gradient(&next);
                (next_value > value).then_some((next, next_value, next_gradient, self.blocks(&shorter)))
            });
            // Where even the shortest step gains nothing, the top is nearer than that.
            let Some((next, next_value, next_gradient, gone)) = better else {
                return (pose, 0.5f64.powi(MAX_HALVINGS) * length.min(LONGEST_STEP));
            };
            (pose, value, gradient) = (next, next_value, next_gradient);
            if gone < self.config.tolerance_px {
                break;
            }
        }
        (pose, 0.0)
    }

    /// The inverse of minus the second derivative with respect to twists, from gradients to both sides along each
    /// column of the preconditioner; `None` where nothing changes the information.
    fn inverse_curvature(&self, pose: &Isometry3<f64>) -> Option<Matrix6<f64>> {
        let column = |axis: usize| {
            let by: Vector6<f64> = self.preconditioner.column(axis) * HALF_WIDTH;
            let [before, after] = [-by, by].map(|by| self.value_and_gradient(&self.moved(pose, &by)).1);
            self.preconditioner.tr_mul(&(before - after)) / (2.0 * HALF_WIDTH)
        };
        let curvature = Matrix6::from_columns(&[0, 1, 2, 3, 4, 5].map(column));
        let most = curvature.amax();
        if !(most.is_finite() && most > f64::EPSILON) {
            return None;
        }
        let eigen = (0.5 * (curvature + curvature.transpose())).symmetric_eigen();
        let least = LEAST_CURVATURE * eigen.eigenvalues.amax();
        let inverse = Matrix6::from_diagonal(&eigen.eigenvalues.map(|value| 1.0 / value.abs().max(least)));
        let basis = self.preconditioner * eigen.eigenvectors;
        Some(basis * inverse * basis.transpose())
    }

    /// Displacement of the points by a twist, in blocks, root mean square.
    fn blocks(&self, twist: &Vector6<f64>) -> f64 {
        self.preconditioner.try_inverse().map_or(f64::INFINITY, |inverse| (inverse * twist).norm())
    }

    fn blocks_between(&self, a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
        let between = b * a.inverse();
        let (rho, phi) = (between.translation.vector, between.rotation.scaled_axis());
        self.blocks(&Vector6::new(rho.x, rho.y, rho.z, phi.x, phi.y, phi.z))
    }
}

#[cfg(test)]
mod tests {
    use super::super::scene::scene;
    use super::*;

    const CONFIG: PolishConfig = PolishConfig {
        edge_band_px: 0,
        max_rounds: 10,
        max_steps: 8,
        tolerance_px: 1e-3,
        max_baseline_m: 1.0,
    };

    #[test]
    fn it_settles_at_the_truth_from_all_sides() {
        let observations = scene(0.0);
        for side in [-1.0, 1.0] {
            let start = se3::exp(&(Vector6::new(0.06, -0.04, 0.04, 0.012, -0.016, 0.02) * side));
            let polished = polish(&observations, &start, None, Counted::All, &CONFIG);
            let error = (polished.pose.rotation.angle(), polished.pose.translation.vector.norm());
            assert!(polished.moved_px < 10.0 * CONFIG.tolerance_px, "{polished:?}");
            // A third of a pixel of this small picture, from two.
            assert!(error.0 < 5e-3 && error.1 < 0.04, "{error:?}");
        }
    }

    #[test]
    fn it_comes_to_the_same_top_with_a_curvature_from_near_by() {
        let observations = scene(0.0);
        let start = se3::exp(&Vector6::new(0.03, -0.02, 0.02, 0.006, -0.008, 0.01));
        let alone = polish(&observations, &start, None, Counted::All, &CONFIG);
        let again = polish(&observations, &start, alone.inverse_curvature.as_ref(), Counted::All, &CONFIG);
        let apart = again.pose * alone.pose.inverse();
        // A third of a pixel of this small picture, as above: its top is rough.
        assert!(apart.rotation.angle() < 5e-3 && apart.translation.vector.norm() < 0.04, "{apart:?}");
    }

    #[test]
    fn where_nothing_changes_it_neither_settles_nor_has_a_curvature() {
        let mut blank = (*scene(0.0)).clone();
        Arc::make_mut(&mut blank.frames[0].point_classes).fill(0);
        let polished = polish(&Arc::new(blank), &Isometry3::identity(), None, Counted::All, &CONFIG);
        assert_eq!((polished.moved_px, polished.inverse_curvature), (f64::INFINITY, None));
    }

    #[test]
    fn it_never_lowers_the_information() {
        let observations = scene(0.4);
        let level = Level::new(Arc::clone(&observations), FACTOR, 0, usize::MAX);
        let information =
            |pose: &Isometry3<f64>, samples: &[Sample]| level.joint(samples, pose).mutual_information();
        let start = se3::exp(&Vector6::new(0.05, 0.05, -0.05, 0.02, 0.02, -0.02));
        let samples = level.samples(&start, Counted::All);
        let one_round = PolishConfig { max_rounds: 1, ..CONFIG };
        let end = polish(&observations, &start, None, Counted::All, &one_round).pose;
        assert!(information(&end, &samples) > information(&start, &samples));
    }
}
