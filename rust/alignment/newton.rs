//! Newton's method on one choice of points, over the pose and the other variables of the estimate.
//!
//! The objective is piecewise smooth with a smoothed cusp at its maximum, so its pointwise second derivative is
//! meaningless: curvature is the difference of gradients across a block. Steps follow independent motions of the
//! points: a rotation of the camera and a shift of the principal point that nearly cancels it become one strong and
//! one weak motion.

use nalgebra::{DMatrix, DVector, Isometry3, Matrix6};

use super::level::Level;
use super::projection::Neighbourhood;
use super::sample::{Sample, Weights};
use super::slopes::Placed;
use crate::mutual_information::JointHistogram;

/// Half-width, blocks (root mean square), of the gradient differences.
pub(super) const HALF_WIDTH: f64 = 0.5;
/// Longest step, blocks.
const MAX_STEP: f64 = 1.0;
/// A step that does not ascend is halved at most this many times before the search ends.
const MAX_HALVINGS: i32 = 4;
/// Curvature floor, relative to the largest eigenvalue.
const MIN_CURVATURE: f64 = 1e-3;
/// Longest step of the translation, metres, however little it moves the points.
const MAX_MOTION_M: f64 = 0.5;

/// Longest translation of a column, relative to the median range, however little it moves the points.
const MAX_MOTION: f64 = 0.05;

impl Level {
    /// Preconditioner of the ascents: six twists, as columns, that each move the points by one block, root mean
    /// square, independently of one another.
    ///
    /// A sideways translation and the rotation that nearly cancels it in the image become one strong and one weak
    /// motion. An ascent follows both at one pace instead of creeping along a valley between them. `None` if
    /// numbers overflow, as for points a million kilometres away.
    pub fn preconditioner(&self, samples: &[Sample], pose: &Isometry3<f64>) -> Option<Matrix6<f64>> {
        let at = self.projection(pose);
        let mut ranges = at.ranges(samples);
        if ranges.is_empty() {
            return None;
        }
        let motions = at.mean_motions(samples) / (self.factor as f64).powi(2);
        let mut moved: Matrix6<f64> = motions.fixed_view::<6, 6>(0, 0).into_owned();
        let middle = ranges.len() / 2;
        let longest = MAX_MOTION * *ranges.select_nth_unstable_by(middle, f64::total_cmp).1;
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

/// Steps, as columns, that each move the points by one block, root mean square, independently of one another. No
/// variable after the pose moves by much more than its standard deviation. `None` if numbers overflow.
pub(super) fn unit_steps(motions: &DMatrix<f64>, sigmas: &[f64]) -> Option<DMatrix<f64>> {
    let mut moved = motions.clone();
    for axis in 0..3 {
        moved[(axis, axis)] += MAX_MOTION_M.powi(-2);
    }
    for (i, sigma) in sigmas.iter().enumerate() {
        moved[(6 + i, 6 + i)] += sigma.powi(-2);
    }
    // Units differ (metres, radians, pixels): each variable is scaled before directions are compared.
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
pub(super) struct PenalisedInformation<'a> {
    pub level: &'a Level,
    pub samples: &'a [Sample],
    /// Pairs of the points that do not change.
    pub constant: &'a JointHistogram,
    pub near: &'a Neighbourhood<'a>,
    /// Weight of the penalty on each variable, nats.
    pub precision: &'a DVector<f64>,
    /// Offset of the variables from their priors so far; the entries of the pose are meaningless.
    pub offset_from_prior: &'a DVector<f64>,
    /// Changes of the variables, as columns, that each move the points by one block.
    pub steps: DMatrix<f64>,
    /// Inverse of `steps`.
    pub blocks: DMatrix<f64>,
}

/// The outcome of Newton's method on one choice of points.
pub(super) struct NewtonResult {
    pub change: DVector<f64>,
    /// Distance, blocks, by which it moved the points.
    pub moved: f64,
    /// Distance, blocks, by which it still tried to move them. Steps without gain mean that the curvature is wrong,
    /// or that the maximum is a cusp.
    pub wanted: f64,
}

impl PenalisedInformation<'_> {
    /// Takes at most `max_steps` steps, until one moves the points by fewer blocks than `tolerance`. `None` if
    /// numbers overflow.
    pub fn newton(&self, inverse: &DMatrix<f64>, max_steps: usize, tolerance: f64) -> Option<NewtonResult> {
        let max_baseline_m = self.level.observations.max_baseline_m;
        let mut change = DVector::zeros(self.steps.nrows());
        let (mut value, mut placed) = self.value(&change)?;
        let mut wanted = 0.0;
        for _ in 0..max_steps {
            let mut step = inverse * self.gradient(&change, placed);
            let length = (&self.blocks * &step).norm();
            if !length.is_finite() {
                return None;
            }
            step *= (MAX_STEP / length).min(1.0);
            let better = (0..=MAX_HALVINGS).find_map(|halvings| {
                let next = self.near.stepped(&change, &(&step * 0.5f64.powi(halvings)), max_baseline_m);
                let (next_value, placed) = self.value(&next)?;
                (next_value > value).then_some((next, next_value, placed))
            });
            // If even the shortest step gains nothing, the maximum is nearer than that.
            let Some((next, next_value, next_placed)) = better else {
                wanted = 0.5f64.powi(MAX_HALVINGS) * length.min(MAX_STEP);
                break;
            };
            let moved = (&self.blocks * (&next - &change)).norm();
            (change, value, placed) = (next, next_value, next_placed);
            if moved < tolerance {
                break;
            }
        }
        let moved = (&self.blocks * &change).norm();
        Some(NewtonResult { change, moved, wanted })
    }

    /// Penalised information, and where the points land; `None` if the camera is impossible.
    pub fn value(&self, change: &DVector<f64>) -> Option<(f64, Placed<'_>)> {
        let placed = self.placed(self.samples, change)?;
        let offset = self.offset_from_prior + change;
        let penalty = 0.5 * self.precision.component_mul(&offset).dot(&offset);
        Some((self.level.information(&placed.joint) - penalty, placed))
    }

    /// Where samples land at a change; `None` if the camera is impossible.
    fn placed(&self, samples: &[Sample], change: &DVector<f64>) -> Option<Placed<'_>> {
        let at = self.near.projection(change).ok()?;
        Some(self.level.placed(samples, self.constant, at, Weights::AtAnchor))
    }

    /// Gradient of the penalised information at a change, by where the points land there.
    pub fn gradient(&self, change: &DVector<f64>, placed: Placed) -> DVector<f64> {
        let pull = self.precision.component_mul(&(self.offset_from_prior + change));
        self.level.gradient(&placed) - pull
    }

    /// Inverse of the negative Hessian by some samples, or all of them, from gradients to both sides along each step;
    /// `None` where the information is constant.
    pub fn inverse_curvature(&self, samples: &[Sample]) -> Option<DMatrix<f64>> {
        let column = |step: usize| {
            let gradient = |by: f64| {
                let change = self.steps.column(step) * by;
                self.placed(samples, &change).map(|placed| self.gradient(&change, placed))
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
        let least = MIN_CURVATURE * eigen.eigenvalues.amax();
        let inverse = eigen.eigenvalues.map(|value| 1.0 / value.abs().max(least));
        let basis = &self.steps * eigen.eigenvectors;
        Some(&basis * DMatrix::from_diagonal(&inverse) * basis.transpose())
    }
}
