//! Newton's method on the pose, intrinsics of the camera and the offset of its clock together, from coarse blocks to
//! pixels.
//!
//! As in the polish, curvature is the difference of gradients across a block, and the points are chosen anew where a round
//! ends. Steps are taken along motions of the points that are independent of one another: a turn of the camera and a shift
//! of the principal point that nearly undoes it are one strong and one weak motion. What was known before keeps the
//! variables where the labels tell nothing: it is a penalty, `sum ((x - x_0) / sigma)^2 / (2 N)`, in which N says how many
//! nats of a likelihood a nat of mutual information is worth.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector, Isometry3, Point2, Vector3};

use super::choice::Chosen;
use super::level::{Level, at_anchor};
use super::sample::{Counted, Sample};
use super::variables::{Estimate, Neighbourhood, Projection, Variables, mean_motions, with_width};
use super::view::in_view;
use crate::error::Result;
use crate::mutual_information::JointHistogram;
use crate::observation::Observations;

/// Distance in blocks to either side at which gradients are taken, root mean square.
const HALF_WIDTH: f64 = 0.5;
/// Steps are no longer than this, in blocks.
const LONGEST_STEP: f64 = 1.0;
/// A step that does not ascend is halved at most this number of times before a round ends.
const MAX_HALVINGS: i32 = 4;
/// Points at least this number of blocks inside one class are summed up once.
const CONSTANT_RADIUS: usize = 2;
/// Directions count as curved at least by this share of the most curved one.
const LEAST_CURVATURE: f64 = 1e-3;
/// Blocks up to this side, pixels, are fine: all points are used.
const FINE: usize = 2;
/// Steps of the translation are no longer than this, metres, however little it moves the points.
const LONGEST_MOTION_M: f64 = 0.5;

/// Settings of [`maximise`].
#[derive(Clone, Debug)]
pub struct JointConfig {
    /// Sides of the blocks of the levels, coarsest first, pixels.
    pub factors: Vec<usize>,
    /// Pixels less than this from one of another class count little.
    pub edge_band_px: usize,
    /// Largest number of points that are used on coarse blocks, over all frames and directions.
    pub max_coarse_points: usize,
    /// Largest number of times that the points are chosen at each level.
    pub max_rounds: usize,
    /// Largest number of Newton steps for each choice of points.
    pub max_steps: usize,
    /// A level ends when a round moved the points by less than this share of a block, root mean square.
    pub tolerance: f64,
    /// The camera stays within this distance of the LiDAR, metres.
    pub max_baseline_m: f64,
    /// Changes of the variables after the pose at the start.
    pub changes: Vec<f64>,
    /// Standard deviations of these variables, by what was known before.
    pub sigmas: Vec<f64>,
    /// Nats of a likelihood that a nat of mutual information is worth.
    pub evidence: f64,
}

/// The estimate at which [`maximise`] ends.
#[derive(Clone, Debug)]
pub struct JointMaximum {
    /// Values of the variables.
    pub estimate: Estimate,
    /// Distance by which the last round moved the points, or still tried to move them, root mean square.
    pub moved_px: f64,
}

/// Ascends to the maximum of the mutual information, less what the variables are off what was known before.
///
/// # Errors
/// The lens has not one of the variables.
pub fn maximise(
    observations: &Arc<Observations>,
    start: &Isometry3<f64>,
    variables: &Variables,
    config: &JointConfig,
) -> Result<JointMaximum> {
    let given = Estimate { pose: *start, camera: observations.camera.clone(), offset_s: 0.0 };
    let mut gone = DVector::zeros(variables.count());
    gone.rows_mut(6, config.changes.len()).copy_from_slice(&config.changes);
    let estimate = given.changed(variables, &gone, config.max_baseline_m)?;
    let mut maximum = JointMaximum { estimate, moved_px: f64::INFINITY };
    for &factor in &config.factors {
        for _ in 0..config.max_rounds {
            let Some(moved) =
                round(observations, variables, config, factor, &mut maximum.estimate, &mut gone)?
            else {
                break;
            };
            maximum.moved_px = moved * factor as f64;
            if moved < config.tolerance {
                break;
            }
        }
    }
    Ok(maximum)
}

/// One choice of points and the steps with it: by how many blocks it moved the points, or wanted to; nothing where the
/// information does not change.
fn round(
    observations: &Arc<Observations>,
    variables: &Variables,
    config: &JointConfig,
    factor: usize,
    estimate: &mut Estimate,
    gone: &mut DVector<f64>,
) -> Result<Option<f64>> {
    let seen = in_view(&estimate.observed(observations, variables), &[estimate.pose]);
    let max_points = if factor > FINE { config.max_coarse_points } else { usize::MAX };
    let level = Level::new(seen, factor, config.edge_band_px, max_points);
    let Chosen { moving: samples, constant } =
        level.chosen(&estimate.pose, Counted::Visible, CONSTANT_RADIUS);
    let anchor = estimate.clone();
    let near = Neighbourhood::new(variables, &anchor)?;
    let n = variables.count();
    let here = near.projection(&DVector::zeros(n))?;
    let precision = DVector::from_fn(n, |i, _| match config.sigmas.get(i.wrapping_sub(6)) {
        Some(sigma) => sigma.powi(-2) / config.evidence,
        None => 0.0,
    });
    let motions = mean_motions(&here, &samples, n) / (factor as f64).powi(2);
    let Some(steps) = unit_steps(&motions, &config.sigmas) else { return Ok(None) };
    let problem = Problem {
        level: &level,
        samples: &samples,
        constant: &constant,
        near: &near,
        precision,
        gone,
        steps,
    };
    let Some((change, blocks)) = problem.newton(config) else { return Ok(None) };
    *estimate = anchor.changed(variables, &change, config.max_baseline_m)?;
    *gone += change;
    Ok(Some(blocks))
}

/// Steps, as columns, that each move the points by one block, root mean square, independently of one another, but no
/// variable by much more than its standard deviation.
fn unit_steps(motions: &DMatrix<f64>, sigmas: &[f64]) -> Option<DMatrix<f64>> {
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

/// The penalised information of one choice of points. Ways are in steps.
struct Problem<'a> {
    level: &'a Level,
    samples: &'a [Sample],
    constant: &'a JointHistogram,
    near: &'a Neighbourhood<'a>,
    /// Weight of the penalty on each variable, nats.
    precision: DVector<f64>,
    /// Change of the variables so far.
    gone: &'a DVector<f64>,
    steps: DMatrix<f64>,
}

impl Problem<'_> {
    /// Newton's method: the change of the variables, and by how many blocks it moved the points or wanted to.
    fn newton(&self, config: &JointConfig) -> Option<(DVector<f64>, f64)> {
        let mut way = DVector::zeros(self.steps.ncols());
        let (mut value, mut gradient) = self.value_and_gradient(&way)?;
        let inverse = self.inverse_curvature()?;
        let mut wanted = 0.0;
        for _ in 0..config.max_steps {
            let mut step = &inverse * &gradient;
            let length = step.norm();
            if !length.is_finite() {
                return None;
            }
            step *= (LONGEST_STEP / length).min(1.0);
            let better = (0..=MAX_HALVINGS).find_map(|halvings| {
                let next = &way + &step * 0.5f64.powi(halvings);
                let (next_value, next_gradient) = self.value_and_gradient(&next)?;
                (next_value > value).then_some((next, next_value, next_gradient))
            });
            // Where even the shortest step gains nothing, the top is nearer than that.
            let Some((next, next_value, next_gradient)) = better else {
                wanted = 0.5f64.powi(MAX_HALVINGS) * length.min(LONGEST_STEP);
                break;
            };
            let gone = (&next - &way).norm();
            (way, value, gradient) = (next, next_value, next_gradient);
            if gone < config.tolerance {
                break;
            }
        }
        Some((&self.steps * &way, way.norm().max(wanted)))
    }

    /// The penalised information and its gradient by the steps; nothing where the camera is impossible.
    fn value_and_gradient(&self, way: &DVector<f64>) -> Option<(f64, DVector<f64>)> {
        let change = &self.steps * way;
        let at = self.near.projection(&change).ok()?;
        let (value, gradient) = with_width!(change.len(), WIDTH => self.information::<WIDTH>(&at));
        let off = self.gone + change;
        let pull = self.precision.component_mul(&off);
        Some((value - 0.5 * pull.dot(&off), self.steps.tr_mul(&(gradient - pull))))
    }

    /// Mutual information, and its gradient by the variables.
    fn information<const WIDTH: usize>(&self, at: &Projection<'_>) -> (f64, DVector<f64>) {
        let place = |sample: &Sample| at.place(sample);
        if self.level.observations.has_partitions() {
            return self.information_by_point(at);
        }
        let motion = |sample: &Sample, p_camera: &Vector3<f64>, pixel: &Point2<f64>| {
            at.motion::<WIDTH>(sample.frame, p_camera, pixel)
        };
        let sloped = self.level.sloped(self.samples, place, at_anchor, motion);
        let joint = sloped.with(self.constant);
        let gradient = sloped.gradient(self.level.values(&joint).of_classes());
        let total = f64::max(joint.total(), 1.0);
        let n = self.steps.nrows();
        (self.level.information(&joint), DVector::from_fn(n, |i, _| gradient[1 + i] / total))
    }

    fn information_by_point(&self, at: &Projection<'_>) -> (f64, DVector<f64>) {
        let place = |sample: &Sample| at.place(sample);
        let (mut joint, mixed) =
            self.level.joint_and_mixed(self.samples, place, at_anchor, |projected| projected);
        joint.merge(self.constant);
        let values = self.level.values(&joint);
        let mut gradient = DVector::zeros(self.steps.nrows());
        mixed
            .iter()
            .flatten()
            .for_each(|projected| at.add_score(self.level, projected, &values, &mut gradient));
        let total = f64::max(self.level.total(&joint), 1.0);
        (self.level.information(&joint), gradient / total)
    }

    /// The inverse of minus the second derivative by the steps.
    fn inverse_curvature(&self) -> Option<DMatrix<f64>> {
        let n = self.steps.ncols();
        let column = |axis: usize| {
            let gradient = |by: f64| {
                let mut way = DVector::zeros(n);
                way[axis] = by;
                self.value_and_gradient(&way).map(|(_, gradient)| gradient)
            };
            Some((gradient(-HALF_WIDTH)? - gradient(HALF_WIDTH)?) / (2.0 * HALF_WIDTH))
        };
        let columns: Vec<DVector<f64>> = (0..n).map(column).collect::<Option<_>>()?;
        let curvature = DMatrix::from_columns(&columns);
        if !curvature.iter().all(|x| x.is_finite()) {
            return None;
        }
        let eigen = (0.5 * (&curvature + curvature.transpose())).symmetric_eigen();
        let least = LEAST_CURVATURE * eigen.eigenvalues.amax();
        if least <= 0.0 {
            return None;
        }
        let inverse = eigen.eigenvalues.map(|value| 1.0 / value.abs().max(least));
        Some(&eigen.eigenvectors * DMatrix::from_diagonal(&inverse) * eigen.eigenvectors.transpose())
    }
}
