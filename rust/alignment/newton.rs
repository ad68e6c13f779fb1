//! Newton's method on one choice of points, over the pose and whatever else is estimated with it.
//!
//! The objective is piecewise smooth with a smoothed cusp at its top, so its pointwise second derivative says nothing:
//! curvature is the difference of gradients across a block. Steps are taken along motions of the points that are
//! independent of one another: a turn of the camera and a shift of the principal point that nearly undoes it are one strong
//! and one weak motion.

use nalgebra::{DMatrix, DVector, Isometry3, Matrix6};

use super::choice::Sample;
use super::level::Level;
use super::projection::Neighbourhood;
use crate::mutual_information::JointHistogram;

/// Distance in blocks to either side at which gradients are taken, root mean square.
pub(super) const HALF_WIDTH: f64 = 0.5;
/// Steps are no longer than this, in blocks.
const LONGEST_STEP: f64 = 1.0;
/// A step that does not ascend is halved at most this number of times before the search ends.
const MAX_HALVINGS: i32 = 4;
/// Directions count as curved at least by this share of the most curved one.
const LEAST_CURVATURE: f64 = 1e-3;
/// Steps of the translation are no longer than this, metres, however little it moves the points.
const LONGEST_MOTION_M: f64 = 0.5;

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

/// Steps, as columns, that each move the points by one block, root mean square, independently of one another, but no
/// variable after the pose by much more than its standard deviation; `None` where numbers overflow.
pub(super) fn unit_steps(motions: &DMatrix<f64>, sigmas: &[f64]) -> Option<DMatrix<f64>> {
    let mut moved = motions.clone();
    for axis in 0..3 {
        moved[(axis, axis)] += LONGEST_MOTION_M.powi(-2);
    }
    for (i, sigma) in sigmas.iter().enumerate() {
        moved[(6 + i, 6 + i)] += sigma.powi(-2);
    }
    // Metres, radians and pixels side by side: each variable is scaled before directions are compared.
    let scale = moved.diagonal().map(|square| 1.0 / square.sqrt());
    let scaled = DMatrix::from_diagonal(&scale) * moved * DMatrix::from_diagonal(&scale);
    if !scaled.iter().all(|x| x.is_finite()) {
        return None;
    }
    let eigen = scaled.symmetric_eigen();
    let most = eigen.eigenvalues.max();
    let lengths = eigen.eigenvalues.map(|value| 1.0 / value.max(f64::EPSILON * most).sqrt());
    Some(DMatrix::from_diagonal(&scale) * eigen.eigenvectors * DMatrix::from_diagonal(&lengths))
}

/// The penalised information of one choice of points.
pub(super) struct Problem<'a> {
    pub level: &'a Level,
    pub samples: &'a [Sample],
    /// Pairs that do not change.
    pub constant: &'a JointHistogram,
    pub near: &'a Neighbourhood<'a>,
    /// The camera stays within this distance of the LiDAR, metres.
    pub max_baseline_m: f64,
    /// Weight of the penalty on each variable, nats.
    pub precision: &'a DVector<f64>,
    /// Change of the variables so far.
    pub gone: &'a DVector<f64>,
    /// Changes of the variables, as columns, that each move the points by one block.
    pub steps: DMatrix<f64>,
    /// The inverse of the steps.
    pub blocks: DMatrix<f64>,
}

/// Where Newton's method went with one choice of points.
pub(super) struct Way {
    pub change: DVector<f64>,
    /// By how many blocks it moved the points.
    pub moved: f64,
    /// By how many blocks it still tried to move them: steps without a gain mean that the curvature is wrong, or that the
    /// top is a cusp.
    pub wanted: f64,
}

impl Problem<'_> {
    /// At most `max_steps` steps, until one moves the points by less blocks than `tolerance`; `None` where numbers overflow.
    pub fn newton(&self, inverse: &DMatrix<f64>, max_steps: usize, tolerance: f64) -> Option<Way> {
        let mut change = DVector::zeros(self.steps.nrows());
        let (mut value, mut gradient) = self.value_and_gradient(&change)?;
        let mut wanted = 0.0;
        for _ in 0..max_steps {
            let mut step = inverse * &gradient;
            let length = (&self.blocks * &step).norm();
            if !length.is_finite() {
                return None;
            }
            step *= (LONGEST_STEP / length).min(1.0);
            let better = (0..=MAX_HALVINGS).find_map(|halvings| {
                let next = self.near.stepped(&change, &(&step * 0.5f64.powi(halvings)), self.max_baseline_m);
                let (next_value, next_gradient) = self.value_and_gradient(&next)?;
                (next_value > value).then_some((next, next_value, next_gradient))
            });
            // Where even the shortest step gains nothing, the top is nearer than that.
            let Some((next, next_value, next_gradient)) = better else {
                wanted = 0.5f64.powi(MAX_HALVINGS) * length.min(LONGEST_STEP);
                break;
            };
            let gone = (&self.blocks * (&next - &change)).norm();
            (change, value, gradient) = (next, next_value, next_gradient);
            if gone < tolerance {
                break;
            }
        }
        let moved = (&self.blocks * &change).norm();
        Some(Way { change, moved, wanted })
    }

    /// The penalised information and its gradient by the variables; nothing where the camera is impossible.
    pub fn value_and_gradient(&self, change: &DVector<f64>) -> Option<(f64, DVector<f64>)> {
        let at = self.near.projection(change).ok()?;
        let (joint, gradient) = self.level.joint_and_gradient(self.samples, self.constant, &at);
        let off = self.gone + change;
        let pull = self.precision.component_mul(&off);
        Some((self.level.information(&joint) - 0.5 * pull.dot(&off), gradient - pull))
    }

    /// The inverse of minus the second derivative by the variables, from gradients to both sides along each step; `None`
    /// where nothing changes the information.
    pub fn inverse_curvature(&self) -> Option<DMatrix<f64>> {
        let column = |step: usize| {
            let gradient = |by: f64| {
                self.value_and_gradient(&(self.steps.column(step) * by)).map(|(_, gradient)| gradient)
            };
            let difference = gradient(-HALF_WIDTH)? - gradient(HALF_WIDTH)?;
            Some(self.steps.tr_mul(&difference) / (2.0 * HALF_WIDTH))
        };
        let columns: Vec<DVector<f64>> = (0..self.steps.ncols()).map(column).collect::<Option<_>>()?;
        let curvature = DMatrix::from_columns(&columns);
        if !(curvature.iter().all(|x| x.is_finite()) && curvature.amax() > f64::EPSILON) {
            return None;
        }
        let eigen = (0.5 * (&curvature + curvature.transpose())).symmetric_eigen();
        let least = LEAST_CURVATURE * eigen.eigenvalues.amax();
        let inverse = eigen.eigenvalues.map(|value| 1.0 / value.abs().max(least));
        let basis = &self.steps * eigen.eigenvectors;
        Some(&basis * DMatrix::from_diagonal(&inverse) * basis.transpose())
    }
}
