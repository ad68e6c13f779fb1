//! Newton's method on one choice of points, over the pose and the other variables of the estimate.
//!
//! The objective is piecewise smooth with a smoothed cusp at its maximum, so its pointwise second derivative is
//! meaningless: curvature is the difference of gradients across a block, and learns from the steps. It is computed along
//! independent motions of the points: a rotation of the camera and a shift of the principal point that nearly cancels it
//! become one strong and one weak motion.

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
/// A trial that does not ascend is shortened to a fraction of its length between these (Nocedal and Wright, section 3.5).
const MIN_SHORTENING: f64 = 0.1;
const MAX_SHORTENING: f64 = 0.5;
/// Shortest trial, relative to the step.
const SHORTEST: f64 = 1.0 / 16.0;
/// The curvature learns from a trial along which the slope falls by at least this share of it: one of the conditions of
/// Wolfe, under which it stays that of a maximum (Nocedal and Wright, eq. 3.6b).
const MIN_FALL: f64 = 0.1;
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
    /// Length, blocks, of the last trial if it gained nothing, because the maximum is a cusp or the curvature wrong; else
    /// zero.
    pub wanted: f64,
}

/// A change that was tried, its value, and where the points land.
struct Trial<'a> {
    change: DVector<f64>,
    value: f64,
    placed: Placed<'a>,
}

impl PenalisedInformation<'_> {
    /// Takes at most `max_steps` steps, until one moves the points by fewer blocks than `tolerance`. `None` if
    /// numbers overflow.
    ///
    /// A copy of the inverse curvature learns from each step, even from one without gain (BFGS; Nocedal and Wright,
    /// Numerical Optimization, eq. 6.17). At a cusp, which no curvature describes, steps thus turn along the ridge instead of
    /// crossing it again and again (Lewis and Overton, Nonsmooth optimization via quasi-Newton methods, 2013). What is
    /// learnt holds for this ridge alone: when it was handed on from one speed of a rig to the next, the fit of the speed
    /// ended at 16 instead of 20 m/s.
    pub fn newton(
        &self,
        mut inverse: DMatrix<f64>,
        max_steps: usize,
        tolerance: f64,
    ) -> Option<NewtonResult> {
        let blocks = |change: &DVector<f64>| (&self.blocks * change).norm();
        let mut change = DVector::zeros(self.steps.nrows());
        let (mut value, placed) = self.value(&change)?;
        let mut gradient = self.gradient(&change, placed);
        let mut wanted = 0.0;
        for _ in 0..max_steps {
            let mut step = &inverse * &gradient;
            let length = blocks(&step);
            if !length.is_finite() {
                return None;
            }
            step *= (MAX_STEP / length).min(1.0);
            // If even the shortest trial gains nothing, the maximum is nearer than that.
            wanted = SHORTEST * length.min(MAX_STEP);
            let Some(Trial { change: next, value: next_value, placed }) =
                self.search_along(&change, value, &step, &gradient)
            else {
                break;
            };
            let (taken, is_higher) = (&next - &change, next_value > value);
            if is_higher {
                wanted = 0.0;
            }
            if blocks(&taken) < tolerance {
                if is_higher {
                    change = next;
                }
                break;
            }
            let next_gradient = self.gradient(&next, placed);
            let has_learnt = learn(&mut inverse, &taken, &gradient, &next_gradient);
            if is_higher {
                (change, value, gradient) = (next, next_value, next_gradient);
            } else if !has_learnt {
                break;
            }
        }
        Some(NewtonResult { moved: blocks(&change), change, wanted })
    }

    /// Shortens a step from a change with a value and a gradient until it gains something. Returns the last trial; `None`
    /// if its camera is impossible.
    fn search_along(
        &self,
        change: &DVector<f64>,
        value: f64,
        step: &DVector<f64>,
        gradient: &DVector<f64>,
    ) -> Option<Trial<'_>> {
        let slope = gradient.dot(step);
        let mut by = 1.0;
        loop {
            let next = self.near.stepped(change, &(step * by), self.level.observations.max_baseline_m);
            let tried = self.value(&next);
            let drop = match &tried {
                Some((next_value, _)) => value - next_value,
                None => f64::INFINITY,
            };
            if drop < 0.0 || by <= SHORTEST {
                return tried.map(|(value, placed)| Trial { change: next, value, placed });
            }
            // To the maximum of the parabola through both values with the slope at the start.
            let rise = slope * by;
            let shortening = (0.5 * rise / (rise + drop)).clamp(MIN_SHORTENING, MAX_SHORTENING);
            by = (by * shortening).max(SHORTEST);
        }
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

/// Updates the inverse of a negative Hessian by a step and the gradients before and after it (BFGS). Returns false if the
/// step says nothing about a maximum, because the slope hardly falls along it.
fn learn(
    inverse: &mut DMatrix<f64>,
    step: &DVector<f64>,
    before: &DVector<f64>,
    after: &DVector<f64>,
) -> bool {
    let lost = before - after;
    let fall = step.dot(&lost);
    let is_telling = fall > MIN_FALL * step.dot(before).abs();
    if is_telling {
        let stretched = &*inverse * &lost;
        let crossed = step * stretched.transpose();
        *inverse += step * step.transpose() * ((1.0 + lost.dot(&stretched) / fall) / fall);
        *inverse -= (&crossed + crossed.transpose()) / fall;
    }
    is_telling
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curvature_learns_what_a_step_shows_and_stays_that_of_a_maximum() {
        let vector = |values: [f64; 3]| DVector::from_column_slice(&values);
        let inverse = DMatrix::from_diagonal(&vector([1.0, 4.0, 0.5]));
        let (step, before) = (vector([0.3, -0.1, 0.2]), vector([1.0, 0.0, 0.5]));
        // Slopes that turn gently, and at a ridge two thousand times as sharp as expected.
        for lost in [vector([0.2, 0.05, 0.1]), &step * 2000.0] {
            let mut learnt = inverse.clone();
            assert!(learn(&mut learnt, &step, &before, &(&before - &lost)));
            // The secant equation.
            assert!((&learnt * &lost - &step).norm() < 1e-12);
            assert!((&learnt - learnt.transpose()).norm() < 1e-12);
            assert!(learnt.symmetric_eigenvalues().min() > 0.0);
        }
        // Slopes that hardly fall, that grow, and that are no numbers are not those of a maximum.
        for lost in [&before * 0.05, &before * -1.0, &before * f64::NAN] {
            let mut unchanged = inverse.clone();
            assert!(!learn(&mut unchanged, &step, &before, &(&before - &lost)));
            assert_eq!(unchanged, inverse);
        }
    }
}
