//! Dependence of the mutual information on the pose and the intrinsics, near a pose: scores and curvature.
//!
//! The score of a part of the data is its share of the gradient. The scatter of the scores measures how far the optimum
//! would move with other data. The objective is piecewise smooth with a smoothed cusp at its maximum, so curvature is
//! the difference of gradients half a pixel to either side.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector, Isometry3, Point2, Vector3, Vector6};
use rayon::prelude::*;

use super::choice::Chosen;
use super::level::{Level, Values};
use super::pose::to_camera;
use super::preconditioner::MAX_MOTION_POINTS;
use super::sample::{Counted, ProjectedSample, Sample};
use super::sloped::{Motion, SlopedHistogram};
use super::view::in_view;
use crate::camera::{Camera, NUM_INTRINSICS};
use crate::mutual_information::JointHistogram;
use crate::observation::Observations;
use crate::pyramid::Sampled;
use crate::se3;

/// Distance in blocks to either side at which gradients are taken, root mean square.
const HALF_WIDTH: f64 = 0.5;
/// Points at least this number of blocks inside one class do not change with the pose.
const CONSTANT_RADIUS: usize = 2;

/// Scores and curvature with respect to a twist on the left of the pose (metres and radians), and if asked for fx, fy, cx,
/// cy (pixels) and k1.
#[derive(Clone, Debug)]
pub struct Sensitivity {
    /// Minus the second derivative, nats.
    pub curvature: DMatrix<f64>,
    /// Mean products of the displacements of the points by the parameters, pixels.
    pub motions: DMatrix<f64>,
    /// Share of each part in the gradient, nats; one row for each part.
    pub scores: DMatrix<f64>,
    /// Frame of each part, and the row and column of its square in the image.
    pub parts: Vec<[u32; 3]>,
    /// Share of each frame in the curvature, nats.
    pub frame_curvatures: Vec<DMatrix<f64>>,
}

/// Settings of [`sensitivity`].
#[derive(Clone, Copy, Debug)]
pub struct SensitivityConfig {
    /// Side of a block of the label images, pixels.
    pub factor: usize,
    /// Pixels less than this from one of another class count little.
    pub edge_band_px: usize,
    /// Largest number of points that are used, over all frames and directions.
    pub max_points: usize,
    /// Whether the intrinsics are parameters beside the pose.
    pub with_intrinsics: bool,
    /// Number of squares across an image that are the parts; with 1, the parts are frames.
    pub regions_across: usize,
}

/// Scores and curvature at a pose, over the points that are visible there.
///
/// `None` where no point projects onto a label, or nothing changes the information.
pub fn sensitivity(
    observations: &Arc<Observations>,
    pose: &Isometry3<f64>,
    config: &SensitivityConfig,
) -> Option<Sensitivity> {
    let level =
        Level::new(in_view(observations, &[*pose]), config.factor, config.edge_band_px, config.max_points);
    let Chosen { moving: mut samples, constant } = level.chosen(pose, Counted::Visible, CONSTANT_RADIUS);
    let to_anchor = to_camera(pose);
    // What is left is a point's share of its class: the labelled share under it is put back where it lands.
    samples.par_iter_mut().for_each(|sample| {
        let sampled = level.sampled(sample, &to_anchor(&sample.position));
        sample.weight = (f64::from(sample.weight) / sampled.map_or(1.0, |sampled| sampled.total())) as f32;
    });
    let problem = Problem { level: &level, samples: &samples, constant: &constant, pose, config };
    let motions = problem.motions();
    let steps = problem.unit_steps(&motions)?;
    let (joint, chunks) = problem.projected(&DVector::zeros(steps.nrows()));
    let total = level.total(&joint);
    let values = level.values(&joint);
    let side = (observations.camera.width as f64 / config.regions_across as f64).max(1.0);
    let mut parts: BTreeMap<[u32; 3], DVector<f64>> = BTreeMap::new();
    for projected in chunks.iter().flatten() {
        let cell = |x: f64| if config.regions_across > 1 { (x.max(0.0) / side) as u32 } else { 0 };
        let part = [projected.frame, cell(projected.pixel.y), cell(projected.pixel.x)];
        let score = parts.entry(part).or_insert_with(|| DVector::zeros(steps.nrows()));
        problem.add_score(projected, &values, score);
    }
    let frame_curvatures = problem.frame_curvatures(&steps)?;
    let n = steps.nrows();
    let curvature = frame_curvatures.iter().fold(DMatrix::zeros(n, n), |sum, frame| sum + frame);
    if !curvature.iter().all(|x| x.is_finite()) || curvature.amax() <= 0.0 {
        return None;
    }
    let rows: Vec<_> = parts.values().map(|score| (score / total).transpose()).collect();
    Some(Sensitivity {
        curvature,
        motions,
        scores: DMatrix::from_rows(&rows),
        parts: parts.into_keys().collect(),
        frame_curvatures,
    })
}

/// The labelled share where a point lands, of its share of a class.
fn weigh_there(sample: &Sample, sampled: &Sampled) -> f32 {
    (f64::from(sample.weight) * sampled.total()) as f32
}

struct Problem<'a> {
    level: &'a Level,
    /// Points whose weights are shares of a class.
    samples: &'a [Sample],
    /// Pairs that do not change.
    constant: &'a JointHistogram,
    pose: &'a Isometry3<f64>,
    config: &'a SensitivityConfig,
}

impl Problem<'_> {
    fn camera(&self) -> &Camera {
        &self.level.observations.camera
    }

    fn num_parameters(&self) -> usize {
        if self.config.with_intrinsics { 6 + NUM_INTRINSICS } else { 6 }
    }

    /// Projections of the points at some parameters, with the weights there: chosen again, as at the end of the polish.
    fn projected(&self, parameters: &DVector<f64>) -> (JointHistogram, Vec<Vec<ProjectedSample>>) {
        let (mut joint, projected) =
            self.level.joint_and_mixed(self.samples, self.projection(parameters), weigh_there, |projected| {
                projected
            });
        joint.merge(self.constant);
        (joint, projected)
    }

    /// A sample in the camera frame, and its pixel, at some parameters.
    fn projection(
        &self,
        parameters: &DVector<f64>,
    ) -> impl Fn(&Sample) -> Option<(Vector3<f64>, Point2<f64>)> + Sync {
        let camera = self.camera();
        let pose = se3::exp(&parameters.fixed_rows::<6>(0).into()) * self.pose;
        let to_camera = to_camera(&pose);
        let intrinsics =
            self.config.with_intrinsics.then(|| parameters.fixed_rows::<NUM_INTRINSICS>(6).into_owned());
        move |sample| {
            let p_camera = to_camera(&sample.position);
            let pixel = camera.project(&p_camera)?;
            let shift = intrinsics.map(|by| camera.intrinsics_jacobian(&pixel) * by);
            Some((p_camera, shift.map_or(pixel, |shift| pixel + shift)))
        }
    }

    /// Shares of the frames in minus the second derivative: differences of gradients along the steps, and back to the
    /// parameters by the steps' inverse from the right.
    fn frame_curvatures(&self, steps: &DMatrix<f64>) -> Option<Vec<DMatrix<f64>>> {
        let differences: Vec<DMatrix<f64>> = (0..steps.ncols())
            .map(|axis| {
                let [before, after] =
                    [-HALF_WIDTH, HALF_WIDTH].map(|by| self.gradients(&(steps.column(axis) * by)));
                (before - after) / (2.0 * HALF_WIDTH)
            })
            .collect();
        let inverse = steps.clone().try_inverse()?;
        let of_frame = |frame: usize| {
            let along: Vec<_> = differences.iter().map(|each| each.column(frame)).collect();
            let curvature = DMatrix::from_columns(&along) * &inverse;
            0.5 * (&curvature + curvature.transpose())
        };
        Some((0..self.level.maps.len()).map(of_frame).collect())
    }

    /// Shares of the frames in the gradient at some parameters, a column for each frame, with the points and weights
    /// chosen at the pose.
    fn gradients(&self, parameters: &DVector<f64>) -> DMatrix<f64> {
        match (self.level.observations.has_partitions(), self.config.with_intrinsics) {
            (true, _) => self.gradients_by_point(parameters),
            (false, false) => self.gradients_by_class::<8>(parameters),
            (false, true) => self.gradients_by_class::<12>(parameters),
        }
    }

    /// The same by the histogram of each frame with its slopes, for points without partitions. There is one slope for
    /// each parameter among the `WIDTH` entries of a cell.
    fn gradients_by_class<const WIDTH: usize>(&self, parameters: &DVector<f64>) -> DMatrix<f64> {
        let n = self.num_parameters();
        let motion = |p_camera: &Vector3<f64>, pixel: &Point2<f64>| {
            let mut motion: Motion<WIDTH> = self.level.motion(p_camera);
            if self.config.with_intrinsics {
                let jacobian = self.camera().intrinsics_jacobian(pixel);
                for (row, of_pixel) in motion.iter_mut().enumerate() {
                    (0..NUM_INTRINSICS).for_each(|i| of_pixel[7 + i] = jacobian[(row, i)]);
                }
            }
            motion
        };
        let project = self.projection(parameters);
        let of_frame = |samples: &&[Sample]| {
            (samples[0].frame as usize, self.level.sloped(samples, &project, weigh_there, motion))
        };
        let frames: Vec<&[Sample]> = self.samples.chunk_by(|a, b| a.frame == b.frame).collect();
        let frames: Vec<(usize, SlopedHistogram<WIDTH>)> = frames.par_iter().map(of_frame).collect();
        let joint = frames.iter().fold(self.constant.clone(), |joint, (_, frame)| frame.with(&joint));
        let values = self.level.values(&joint);
        let mut gradients = DMatrix::zeros(n, self.level.maps.len());
        for (frame, sloped) in &frames {
            gradients.column_mut(*frame).copy_from(&sloped.gradient(values.of_classes()).rows(1, n));
        }
        gradients / self.level.total(&joint).max(1.0)
    }

    /// The same point by point.
    fn gradients_by_point(&self, parameters: &DVector<f64>) -> DMatrix<f64> {
        let (joint, chunks) = self.projected(parameters);
        let values = self.level.values(&joint);
        let of_chunk = |chunk: &Vec<ProjectedSample>| {
            let mut sums: Vec<(usize, DVector<f64>)> = Vec::new();
            for projected in chunk {
                let frame = projected.frame as usize;
                if sums.last().is_none_or(|(last, _)| *last != frame) {
                    sums.push((frame, DVector::zeros(self.num_parameters())));
                }
                let (_, sum) = sums.last_mut().expect("one was just added");
                self.add_score(projected, &values, sum);
            }
            sums
        };
        let sums: Vec<_> = chunks.par_iter().flat_map_iter(of_chunk).collect();
        let mut gradients = DMatrix::zeros(self.num_parameters(), self.level.maps.len());
        for (frame, sum) in sums {
            let mut column = gradients.column_mut(frame);
            column += sum;
        }
        gradients / self.level.total(&joint).max(1.0)
    }

    /// Adds the contribution of a point to the gradient, times the total weight.
    fn add_score(&self, projected: &ProjectedSample, values: &Values<'_>, sum: &mut DVector<f64>) {
        let ProjectedSample { frame, weight, p_camera, pixel, .. } = projected;
        let Sampled::Mixed(shares) = self.level.maps[*frame as usize].at(pixel) else { return };
        let per_pixel = values.of(projected, |values| shares.gradient(values)) * f64::from(*weight);
        let force: Vector3<f64> = self.camera().jacobian(p_camera).tr_mul(&per_pixel);
        let torque = p_camera.cross(&force);
        let twist = Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z);
        let mut pose = sum.fixed_rows_mut::<6>(0);
        pose += twist;
        if self.config.with_intrinsics {
            let mut intrinsics = sum.fixed_rows_mut::<NUM_INTRINSICS>(6);
            intrinsics += self.camera().intrinsics_jacobian(pixel).tr_mul(&per_pixel);
        }
    }

    /// Mean products of the displacements of the points by the parameters, pixels: `d^T G d` is the mean square
    /// displacement by a change `d`.
    fn motions(&self) -> DMatrix<f64> {
        let n = self.num_parameters();
        let to_camera = to_camera(self.pose);
        let (mut sum, mut count) = (DMatrix::zeros(n, n), 0.0);
        let step = self.samples.len().div_ceil(MAX_MOTION_POINTS).max(1);
        for sample in self.samples.iter().step_by(step) {
            let p_camera = to_camera(&sample.position);
            let Some((pixel, jacobian)) = self.camera().project_with_jacobian(&p_camera) else { continue };
            let mut moved = DMatrix::zeros(2, n);
            moved.fixed_view_mut::<2, 3>(0, 0).copy_from(&jacobian);
            moved.fixed_view_mut::<2, 3>(0, 3).copy_from(&(-jacobian * p_camera.cross_matrix()));
            if self.config.with_intrinsics {
                let intrinsics = self.camera().intrinsics_jacobian(&pixel);
                moved.fixed_view_mut::<2, NUM_INTRINSICS>(0, 6).copy_from(&intrinsics);
            }
            sum += moved.tr_mul(&moved);
            count += 1.0;
        }
        sum / f64::max(count, 1.0)
    }

    /// Steps, as columns, that each move the points by one block, root mean square; those of the pose do so independently
    /// of one another.
    fn unit_steps(&self, motions: &DMatrix<f64>) -> Option<DMatrix<f64>> {
        let n = self.num_parameters();
        let mut steps = DMatrix::zeros(n, n);
        steps.fixed_view_mut::<6, 6>(0, 0).copy_from(&self.level.preconditioner(self.samples, self.pose)?);
        for axis in 6..n {
            let pixels = motions[(axis, axis)].sqrt();
            if !(pixels.is_finite() && pixels > 0.0) {
                return None;
            }
            steps[(axis, axis)] = self.level.factor as f64 / pixels;
        }
        Some(steps)
    }
}

#[cfg(test)]
mod tests {
    use super::super::scene::scene;
    use super::*;

    const CONFIG: SensitivityConfig = SensitivityConfig {
        factor: 1,
        edge_band_px: 0,
        max_points: usize::MAX,
        with_intrinsics: true,
        regions_across: 3,
    };

    fn near() -> Isometry3<f64> {
        se3::exp(&Vector6::new(0.01, -0.02, 0.01, 0.004, 0.003, -0.006))
    }

    #[test]
    fn scores_add_up_to_the_gradient() {
        let observations = scene(0.3);
        let pose = near();
        let found = sensitivity(&observations, &pose, &CONFIG).expect("points on labels");
        let level = Level::new(Arc::clone(&observations), 1, 0, usize::MAX);
        let samples = level.samples(&pose, Counted::Visible);
        let (_, gradient) = level.joint_and_gradient(&samples, &level.empty_joint(), &pose);
        assert!(found.scores.nrows() > 4);
        let sum = found.scores.row_sum().transpose();
        assert!((sum.fixed_rows::<6>(0) - gradient).norm() < 1e-9 * gradient.norm(), "{sum} {gradient}");
        let pose_only = SensitivityConfig { with_intrinsics: false, ..CONFIG };
        let of_pose = sensitivity(&observations, &pose, &pose_only).expect("points on labels");
        assert!((of_pose.scores - found.scores.columns(0, 6)).norm() < 1e-12);
        assert!((of_pose.curvature - found.curvature.view((0, 0), (6, 6))).norm() < 1e-6);
    }

    #[test]
    fn information_bends_down_at_its_top() {
        let observations = scene(0.0);
        let found = sensitivity(
            &observations,
            &Isometry3::identity(),
            &SensitivityConfig { with_intrinsics: false, ..CONFIG },
        )
        .expect("points on labels");
        let scale = found.motions.diagonal().map(|square| 1.0 / square.sqrt());
        let scaled = DMatrix::from_diagonal(&scale) * found.curvature * DMatrix::from_diagonal(&scale);
        assert!(scaled.symmetric_eigenvalues().min() > 0.0);
    }
}
