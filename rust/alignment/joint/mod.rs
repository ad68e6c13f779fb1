//! Newton's method on the pose, intrinsics of the camera and the offset of its clock together, from coarse blocks to
//! pixels.
//!
//! As in the polish, curvature is the difference of gradients across a block, and the points are chosen anew where a round
//! ends. Steps are taken along motions of the points that are independent of one another: a turn of the camera and a shift
//! of the principal point that nearly undoes it are one strong and one weak motion. What was known before keeps the
//! variables where the labels tell nothing: it is a penalty, `sum ((x - x_0) / sigma)^2 / (2 N)`, in which N says how many
//! nats of a likelihood a nat of mutual information is worth.

#[cfg(test)]
mod tests;

use std::sync::Arc;

use nalgebra::{DMatrix, DVector, Isometry3, Point2, Vector3};

use crate::alignment::choice::Chosen;
use crate::alignment::level::{Level, at_anchor};
use crate::alignment::sample::{Counted, Sample};
use crate::alignment::variables::{Estimate, Neighbourhood, Projection, Variables, with_width};
use crate::alignment::view::in_view;
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
/// Curvature is taken again if the last round moved the points by more blocks than this.
const CURVATURE_HOLDS: f64 = 0.3;
/// Levels but the last end when a round moved the points by less blocks than this.
const COARSE_TOLERANCE: f64 = 0.1;
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
    /// The last level ends when a round moved the points by less than this share of a block, root mean square.
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
    let mut climb = Climb { observations, variables, config, estimate, gone, inverse_curvature: None };
    let mut moved_px = f64::INFINITY;
    for (&factor, is_last) in config.factors.iter().zip(is_last(config.factors.len())) {
        // Curvature in other blocks is another one.
        climb.inverse_curvature = None;
        moved_px = f64::INFINITY;
        // Blocks are averaged once for all rounds as long as somebody holds them.
        let _held = Level::new(Arc::clone(observations), factor, config.edge_band_px, usize::MAX);
        let tolerance = if is_last { config.tolerance } else { COARSE_TOLERANCE };
        for _ in 0..config.max_rounds {
            let Some(Round { moved, wanted, is_fresh }) = climb.round(factor, tolerance)? else { break };
            moved_px = moved.max(wanted) * factor as f64;
            // A step that gained nothing may be that of an old curvature, or a cusp is the top.
            if moved < tolerance && (wanted < tolerance || is_fresh) {
                break;
            }
        }
    }
    Ok(JointMaximum { estimate: climb.estimate, moved_px })
}

/// Whether each of some levels is the last.
fn is_last(count: usize) -> impl Iterator<Item = bool> {
    (1..=count).map(move |number| number == count)
}

/// What became of one choice of points.
struct Round {
    /// By how many blocks it moved the points.
    moved: f64,
    /// By how many blocks it still tried to move them.
    wanted: f64,
    /// Whether the curvature is that of these points.
    is_fresh: bool,
}

/// A climb on its way.
struct Climb<'a> {
    observations: &'a Arc<Observations>,
    variables: &'a Variables,
    config: &'a JointConfig,
    estimate: Estimate,
    /// Change of the variables from what was known before; that of the pose means nothing.
    gone: DVector<f64>,
    /// Inverse of minus the second derivative by the variables, while it holds.
    inverse_curvature: Option<DMatrix<f64>>,
}

impl Climb<'_> {
    /// One choice of points and the steps with it; nothing where the information does not change.
    fn round(&mut self, factor: usize, tolerance: f64) -> Result<Option<Round>> {
        let Self { variables, config, .. } = *self;
        let anchor = self.estimate.clone();
        let seen = in_view(&anchor.observed(self.observations, variables), &[anchor.pose]);
        let max_points = if factor > FINE { config.max_coarse_points } else { usize::MAX };
        let level = Level::new(seen, factor, config.edge_band_px, max_points);
        let Chosen { moving: samples, constant } =
            level.chosen(&anchor.pose, Counted::Visible, CONSTANT_RADIUS);
        let near = Neighbourhood::new(variables, &anchor)?;
        let n = variables.count();
        let here = near.projection(&DVector::zeros(n))?;
        let precision = DVector::from_fn(n, |i, _| match config.sigmas.get(i.wrapping_sub(6)) {
            Some(sigma) => sigma.powi(-2) / config.evidence,
            None => 0.0,
        });
        let motions = here.mean_motions(&samples) / (factor as f64).powi(2);
        let Some(steps) = unit_steps(&motions, &config.sigmas) else { return Ok(None) };
        let Some(blocks) = steps.clone().try_inverse() else { return Ok(None) };
        let (level, samples, constant, near, gone) = (&level, &samples[..], &constant, &near, &self.gone);
        let max_baseline_m = config.max_baseline_m;
        let problem =
            Problem { level, samples, constant, near, max_baseline_m, precision, gone, steps, blocks };
        let is_fresh = self.inverse_curvature.is_none();
        let inverse = match self.inverse_curvature.take() {
            Some(inverse) => inverse,
            None => match problem.inverse_curvature() {
                Some(inverse) => inverse,
                None => return Ok(None),
            },
        };
        let Some(Way { change, moved, wanted }) = problem.newton(&inverse, config.max_steps, tolerance)
        else {
            return Ok(None);
        };
        self.estimate = anchor.changed(variables, &change, config.max_baseline_m)?;
        self.gone += change;
        if moved <= CURVATURE_HOLDS && (wanted < tolerance || is_fresh) {
            self.inverse_curvature = Some(inverse);
        }
        Ok(Some(Round { moved, wanted, is_fresh }))
    }
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

/// The penalised information of one choice of points.
struct Problem<'a> {
    level: &'a Level,
    samples: &'a [Sample],
    constant: &'a JointHistogram,
    near: &'a Neighbourhood<'a>,
    /// The camera stays within this distance of the LiDAR, metres.
    max_baseline_m: f64,
    /// Weight of the penalty on each variable, nats.
    precision: DVector<f64>,
    /// Change of the variables so far.
    gone: &'a DVector<f64>,
    /// Changes of the variables, as columns, that each move the points by one block.
    steps: DMatrix<f64>,
    /// The inverse of the steps.
    blocks: DMatrix<f64>,
}

/// Where Newton's method went with one choice of points.
struct Way {
    /// Change of the variables.
    change: DVector<f64>,
    /// By how many blocks it moved the points.
    moved: f64,
    /// By how many blocks it still tried to move them: steps without a gain mean that the curvature is wrong, or that the
    /// top is a cusp.
    wanted: f64,
}

impl Problem<'_> {
    fn newton(&self, inverse: &DMatrix<f64>, max_steps: usize, tolerance: f64) -> Option<Way> {
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
                let next = &change + &step * 0.5f64.powi(halvings);
                let next = self.near.within_baseline(next, self.max_baseline_m);
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
    fn value_and_gradient(&self, change: &DVector<f64>) -> Option<(f64, DVector<f64>)> {
        let at = self.near.projection(change).ok()?;
        let (value, gradient) = with_width!(change.len(), WIDTH => self.information::<WIDTH>(&at));
        let off = self.gone + change;
        let pull = self.precision.component_mul(&off);
        Some((value - 0.5 * pull.dot(&off), gradient - pull))
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

    /// The inverse of minus the second derivative by the variables, from gradients to both sides along each step.
    fn inverse_curvature(&self) -> Option<DMatrix<f64>> {
        let column = |step: usize| {
            let gradient = |by: f64| {
                self.value_and_gradient(&(self.steps.column(step) * by)).map(|(_, gradient)| gradient)
            };
            let difference = gradient(-HALF_WIDTH)? - gradient(HALF_WIDTH)?;
            Some(self.steps.tr_mul(&difference) / (2.0 * HALF_WIDTH))
        };
        let columns: Vec<DVector<f64>> = (0..self.steps.ncols()).map(column).collect::<Option<_>>()?;
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
        let basis = &self.steps * eigen.eigenvectors;
        Some(&basis * DMatrix::from_diagonal(&inverse) * basis.transpose())
    }
}
