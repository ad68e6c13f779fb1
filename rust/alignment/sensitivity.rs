//! Dependence of the mutual information on the pose and the intrinsics, near a pose: scores and curvature.
//!
//! The score of a part of the data, the points of one class in one square of an image, is its share of the gradient. The
//! scatter of the scores measures how far the optimum would move with other data. The objective is piecewise smooth with
//! a smoothed cusp at its maximum, so curvature is the difference of gradients half a pixel to either side.

use std::collections::BTreeMap;
use std::ops::AddAssign;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector, Isometry3, Point2, Vector3};
use rayon::prelude::*;

use super::choice::Chosen;
use super::level::Level;
use super::pose::to_camera;
use super::sample::{Counted, ProjectedSample, Sample};
use super::sloped::SlopedHistogram;
use super::variables::{Estimate, Neighbourhood, Projection, Variables, with_width};
use super::view::in_view;
use crate::mutual_information::JointHistogram;
use crate::observation::Observations;
use crate::pyramid::Sampled;

/// Distance in blocks to either side at which gradients are taken, root mean square.
const HALF_WIDTH: f64 = 0.5;
/// Points at least this number of blocks inside one class do not change with the pose.
const CONSTANT_RADIUS: usize = 2;

/// Scores and curvature with respect to the variables: a twist on the left of the pose (metres and radians), and others.
#[derive(Clone, Debug)]
pub struct Sensitivity {
    /// Minus the second derivative, nats.
    pub curvature: DMatrix<f64>,
    /// Mean products of the displacements of the points by the variables, pixels.
    pub motions: DMatrix<f64>,
    /// Share of each part in the gradient, nats; one row for each part.
    pub scores: DMatrix<f64>,
    /// Frame of each part, the row and column of its square in the image, and the class of its points. That of segments
    /// is the class of the image under them, numbered after those of points.
    pub parts: Vec<[u32; 4]>,
    /// Share of each frame in the curvature, nats.
    pub frame_curvatures: Vec<DMatrix<f64>>,
    /// Share of each class, as in `parts`, in the curvature, nats.
    pub class_curvatures: Vec<DMatrix<f64>>,
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
    /// Number of squares across an image that are the parts; with 1, the parts are frames.
    pub regions_across: usize,
}

/// Scores and curvature at a pose, over the points that are visible there.
///
/// `None` where no point projects onto a label, nothing changes the information, or the lens has not one of the variables.
pub fn sensitivity(
    observations: &Arc<Observations>,
    pose: &Isometry3<f64>,
    variables: &Variables,
    config: &SensitivityConfig,
) -> Option<Sensitivity> {
    let level =
        Level::new(in_view(observations, &[*pose]), config.factor, config.edge_band_px, config.max_points);
    let Chosen { moving: mut samples, constant } = level.chosen(pose, Counted::Visible, CONSTANT_RADIUS);
    let to_anchor = to_camera(pose);
    // What is left is a point's share of its class: the labelled share under it is put back where it lands. Segments are
    // of one sweep: what they share with those of others is the class of the picture that they lie on.
    samples.par_iter_mut().for_each(|sample| {
        let sampled = level.sampled(sample, &to_anchor(&sample.position));
        if observations.frames[sample.frame as usize].partitions.is_some() {
            let under = sampled.as_ref().and_then(Sampled::largest);
            let class = under.map(|class| observations.num_point_classes + usize::from(class));
            sample.class = class.and_then(|class| u8::try_from(class).ok()).unwrap_or(sample.class);
        }
        sample.weight = (f64::from(sample.weight) / sampled.map_or(1.0, |sampled| sampled.total())) as f32;
    });
    let anchor = Estimate { pose: *pose, camera: observations.camera.clone(), offset_s: 0.0 };
    let near = Neighbourhood::new(variables, &anchor).ok()?;
    let n = variables.count();
    let problem = Problem { level: &level, samples: &samples, constant: &constant, near: &near, n };
    let here = near.projection(&DVector::zeros(n)).ok()?;
    let motions = here.mean_motions(&samples);
    let steps = problem.unit_steps(&motions, pose)?;
    let (joint, chunks) = problem.projected(&here);
    let total = level.total(&joint);
    let values = level.values(&joint);
    let side = (observations.camera.width as f64 / config.regions_across as f64).max(1.0);
    let mut parts: BTreeMap<[u32; 4], DVector<f64>> = BTreeMap::new();
    for projected in chunks.iter().flatten() {
        let cell = |x: f64| if config.regions_across > 1 { (x.max(0.0) / side) as u32 } else { 0 };
        let (row, column) = (cell(projected.pixel.y), cell(projected.pixel.x));
        let part = [projected.frame, row, column, u32::from(projected.class)];
        let score = parts.entry(part).or_insert_with(|| DVector::zeros(n));
        here.add_score(&level, projected, &values, score);
    }
    let Shares { of_frames: frame_curvatures, of_classes: class_curvatures } = problem.curvatures(&steps)?;
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
        class_curvatures,
    })
}

/// The labelled share where a point lands, of its share of a class.
fn weigh_there(sample: &Sample, sampled: &Sampled) -> f32 {
    (f64::from(sample.weight) * sampled.total()) as f32
}

/// Shares of the frames, and of the classes of points, in a sum over all points.
struct Shares<T> {
    of_frames: T,
    of_classes: T,
}

impl Shares<DMatrix<f64>> {
    fn add(&mut self, frame: usize, class: usize, sum: &DVector<f64>) {
        self.of_frames.column_mut(frame).add_assign(sum);
        self.of_classes.column_mut(class).add_assign(sum);
    }

    fn per(self, total: f64) -> Self {
        let total = total.max(1.0);
        Self { of_frames: self.of_frames / total, of_classes: self.of_classes / total }
    }
}

struct Problem<'a> {
    level: &'a Level,
    /// Points whose weights are shares of a class.
    samples: &'a [Sample],
    /// Pairs that do not change.
    constant: &'a JointHistogram,
    near: &'a Neighbourhood<'a>,
    /// Number of variables.
    n: usize,
}

impl Problem<'_> {
    /// The points at some projection, with the weights there: chosen again, as at the end of the polish.
    fn projected(&self, at: &Projection<'_>) -> (JointHistogram, Vec<Vec<ProjectedSample>>) {
        let place = |sample: &Sample| at.place(sample);
        let (mut joint, projected) =
            self.level.joint_and_mixed(self.samples, place, weigh_there, |projected| projected);
        joint.merge(self.constant);
        (joint, projected)
    }

    /// Shares in minus the second derivative: differences of gradients along the steps, and back to the variables by the
    /// steps' inverse from the right.
    fn curvatures(&self, steps: &DMatrix<f64>) -> Option<Shares<Vec<DMatrix<f64>>>> {
        let along = |axis: usize| {
            let gradients = |by: f64| self.gradients(&self.near.projection(&(steps.column(axis) * by)).ok()?);
            let (before, after) = (gradients(-HALF_WIDTH)?, gradients(HALF_WIDTH)?);
            let difference = |before, after: DMatrix<f64>| (before - after) / (2.0 * HALF_WIDTH);
            Some(Shares {
                of_frames: difference(before.of_frames, after.of_frames),
                of_classes: difference(before.of_classes, after.of_classes),
            })
        };
        let differences: Vec<Shares<DMatrix<f64>>> = (0..steps.ncols()).map(along).collect::<Option<_>>()?;
        let inverse = steps.clone().try_inverse()?;
        let curvatures = |of: fn(&Shares<DMatrix<f64>>) -> &DMatrix<f64>| {
            let count = differences.first().map_or(0, |each| of(each).ncols());
            let curvature = |place: usize| {
                let along: Vec<_> = differences.iter().map(|each| of(each).column(place)).collect();
                let curvature = DMatrix::from_columns(&along) * &inverse;
                0.5 * (&curvature + curvature.transpose())
            };
            (0..count).map(curvature).collect()
        };
        Some(Shares {
            of_frames: curvatures(|each| &each.of_frames),
            of_classes: curvatures(|each| &each.of_classes),
        })
    }

    /// Shares in the gradient at some projection, with the points and weights chosen at the pose.
    fn gradients(&self, at: &Projection<'_>) -> Option<Shares<DMatrix<f64>>> {
        if self.level.observations.has_partitions() {
            return Some(self.gradients_by_point(at));
        }
        with_width!(self.n, WIDTH => Some(self.gradients_by_class::<WIDTH>(at)))
    }

    /// The same by the histogram of each frame with its slopes, for points without partitions. There is one slope for
    /// each variable among the `WIDTH` entries of a cell.
    fn gradients_by_class<const WIDTH: usize>(&self, at: &Projection<'_>) -> Shares<DMatrix<f64>> {
        let place = |sample: &Sample| at.place(sample);
        let of_frame = |samples: &&[Sample]| {
            let motion = |sample: &Sample, p_camera: &Vector3<f64>, pixel: &Point2<f64>| {
                at.motion::<WIDTH>(sample.frame, p_camera, pixel)
            };
            (samples[0].frame as usize, self.level.sloped(samples, place, weigh_there, motion))
        };
        let frames: Vec<&[Sample]> = self.samples.chunk_by(|a, b| a.frame == b.frame).collect();
        let frames: Vec<(usize, SlopedHistogram<WIDTH>)> = frames.par_iter().map(of_frame).collect();
        let joint = frames.iter().fold(self.constant.clone(), |joint, (_, frame)| frame.with(&joint));
        let values = self.level.values(&joint);
        let mut sums = self.no_gradients();
        for (frame, sloped) in &frames {
            for (class, gradient) in sloped.gradients(values.of_classes()).enumerate() {
                sums.add(*frame, class, &gradient.rows(1, self.n).into_owned());
            }
        }
        sums.per(self.level.total(&joint))
    }

    /// The same point by point.
    fn gradients_by_point(&self, at: &Projection<'_>) -> Shares<DMatrix<f64>> {
        let (joint, chunks) = self.projected(at);
        let values = self.level.values(&joint);
        let of_chunk = |chunk: &Vec<ProjectedSample>| {
            let mut sums: Vec<((usize, usize), DVector<f64>)> = Vec::new();
            for projected in chunk {
                let place = (projected.frame as usize, usize::from(projected.class));
                if sums.last().is_none_or(|(last, _)| *last != place) {
                    sums.push((place, DVector::zeros(self.n)));
                }
                if let Some((_, sum)) = sums.last_mut() {
                    at.add_score(self.level, projected, &values, sum);
                }
            }
            sums
        };
        let chunks: Vec<_> = chunks.par_iter().flat_map_iter(of_chunk).collect();
        let mut sums = self.no_gradients();
        for ((frame, class), sum) in chunks {
            sums.add(frame, class, &sum);
        }
        sums.per(self.level.total(&joint))
    }

    fn no_gradients(&self) -> Shares<DMatrix<f64>> {
        let observations = &self.level.observations;
        let of_images = if observations.has_partitions() { observations.num_image_classes } else { 0 };
        let num_classes = observations.num_point_classes + of_images;
        Shares {
            of_frames: DMatrix::zeros(self.n, self.level.maps.len()),
            of_classes: DMatrix::zeros(self.n, num_classes),
        }
    }

    /// Steps, as columns, that each move the points by one block, root mean square; those of the pose do so independently
    /// of one another.
    fn unit_steps(&self, motions: &DMatrix<f64>, pose: &Isometry3<f64>) -> Option<DMatrix<f64>> {
        let mut steps = DMatrix::zeros(self.n, self.n);
        steps.fixed_view_mut::<6, 6>(0, 0).copy_from(&self.level.preconditioner(self.samples, pose)?);
        for axis in 6..self.n {
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
    use nalgebra::Vector6;

    use super::super::scene::scene;
    use super::*;
    use crate::camera::Intrinsic;
    use crate::se3;

    const CONFIG: SensitivityConfig =
        SensitivityConfig { factor: 1, edge_band_px: 0, max_points: usize::MAX, regions_across: 3 };

    fn with_intrinsics() -> Variables {
        let names = ["fx", "fy", "cx", "cy", "radial"];
        Variables { intrinsics: names.iter().filter_map(|name| Intrinsic::of(name)).collect(), twists: None }
    }

    fn near() -> Isometry3<f64> {
        se3::exp(&Vector6::new(0.01, -0.02, 0.01, 0.004, 0.003, -0.006))
    }

    #[test]
    fn scores_add_up_to_the_gradient() {
        let observations = scene(0.3);
        let pose = near();
        let found = sensitivity(&observations, &pose, &with_intrinsics(), &CONFIG).expect("points on labels");
        let level = Level::new(Arc::clone(&observations), 1, 0, usize::MAX);
        let samples = level.samples(&pose, Counted::Visible);
        let (_, gradient) = level.joint_and_gradient(&samples, &level.empty_joint(), &pose);
        assert!(found.scores.nrows() > 4);
        let sum = found.scores.row_sum().transpose();
        assert!((sum.fixed_rows::<6>(0) - gradient).norm() < 1e-9 * gradient.norm(), "{sum} {gradient}");
        let of_pose =
            sensitivity(&observations, &pose, &Variables::default(), &CONFIG).expect("points on labels");
        assert!((of_pose.scores - found.scores.columns(0, 6)).norm() < 1e-12);
        assert!((of_pose.curvature - found.curvature.view((0, 0), (6, 6))).norm() < 1e-6);
    }

    #[test]
    fn information_bends_down_at_its_top() {
        let observations = scene(0.0);
        let found = sensitivity(&observations, &Isometry3::identity(), &Variables::default(), &CONFIG)
            .expect("points on labels");
        let scale = found.motions.diagonal().map(|square| 1.0 / square.sqrt());
        let scaled = DMatrix::from_diagonal(&scale) * found.curvature * DMatrix::from_diagonal(&scale);
        assert!(scaled.symmetric_eigenvalues().min() > 0.0);
    }
}
