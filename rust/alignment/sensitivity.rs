//! Sensitivity of the mutual information to the pose and the intrinsics, near a pose: scores and curvature.
//!
//! The score of one part of the data, the points of one class in one square of an image, is its share of the
//! gradient. The scatter of the scores measures how far the optimum would move with other data. The objective is
//! piecewise smooth with a smoothed cusp at its maximum, so curvature is the difference of gradients half a pixel
//! to either side.

use std::collections::BTreeMap;
use std::ops::AddAssign;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector, Isometry3, Point2};
use rayon::prelude::*;

use super::level::Level;
use super::newton::{HALF_WIDTH, unit_steps};
use super::projection::{Neighbourhood, Projection};
use super::sample::{Sample, Weights};
use super::selection::{Selection, in_view};
use super::slopes::{Placed, Split, add_score};
use super::variables::{Estimate, MAX_VARIABLES, Variables};
use crate::mutual_information::JointHistogram;
use crate::observation::Observations;
use crate::pyramid::Sampled;

/// Longest change of an intrinsic or of the time offset in a step: that which moves the points by this many blocks
/// while the pose stays.
const MAX_BLOCKS: f64 = 20.0;

/// Scores and curvature with respect to the variables: a twist on the left of the pose (metres and radians), and
/// others.
#[derive(Clone, Debug)]
pub struct Sensitivity {
    /// Negative Hessian, nats.
    pub curvature: DMatrix<f64>,
    /// Mean outer products of the points' displacements by the variables, pixels.
    pub motions: DMatrix<f64>,
    /// Contribution of each part to the gradient, nats, one row each.
    pub scores: DMatrix<f64>,
    /// Frame of each part, row and column of its square in the image, and class of its points. For segments, the
    /// class is that of the image under them, numbered after those of points.
    pub parts: Vec<[u32; 4]>,
    /// Contribution of each frame to the curvature, nats.
    pub frame_curvatures: Vec<DMatrix<f64>>,
    /// Contribution of each class, numbered as in `parts`, to the curvature, nats.
    pub class_curvatures: Vec<DMatrix<f64>>,
}

/// Settings: the fields of `SensitivityConfig` in Python, which documents them.
#[derive(Clone, Copy, Debug)]
pub struct SensitivityConfig {
    pub factor: usize,
    pub max_points: usize,
    pub regions_across: usize,
}

/// Scores and curvature at a pose, over the points visible there.
///
/// `None` if no point projects onto a label, the information is constant, or the lens lacks one of the variables.
pub fn sensitivity(
    observations: &Arc<Observations>,
    pose: &Isometry3<f64>,
    variables: &Variables,
    config: &SensitivityConfig,
) -> Option<Sensitivity> {
    let level = Level::new(in_view(observations, &[*pose]), &[*pose], config.factor, config.max_points);
    let Selection { moving: mut samples, constant, .. } = level.select_for_newton(pose, variables);
    level.as_shares_of_classes(&mut samples, pose);
    let anchor = Estimate { pose: *pose, camera: observations.camera.clone(), offset_s: 0.0 };
    let near = Neighbourhood::new(variables, &anchor).ok()?;
    let n = variables.count();
    let problem = Problem { level: &level, samples: &samples, constant: &constant, near: &near, n };
    let here = near.projection(&DVector::zeros(n)).ok()?;
    let motions = here.mean_motions(&samples);
    let steps = problem.unit_steps(&motions, pose)?;
    let side = (observations.camera.width as f64 / config.regions_across as f64).max(1.0);
    let cell = |x: f64| if config.regions_across > 1 { (x.max(0.0) / side) as u32 } else { 0 };
    let scores = problem.scores(&here, |pixel| [cell(pixel.y), cell(pixel.x)]);
    let Shares { of_frames: frame_curvatures, of_classes: class_curvatures } = problem.curvatures(&steps)?;
    let curvature = frame_curvatures.iter().fold(DMatrix::zeros(n, n), |sum, frame| sum + frame);
    if !curvature.iter().all(|x| x.is_finite()) || curvature.amax() <= 0.0 {
        return None;
    }
    let rows: Vec<_> = scores.values().map(DVector::transpose).collect();
    Some(Sensitivity {
        curvature,
        motions,
        scores: DMatrix::from_rows(&rows),
        parts: scores.into_keys().collect(),
        frame_curvatures,
        class_curvatures,
    })
}

impl Level {
    /// Turns the weights of samples at a pose into shares of a class: the labelled share under a point is applied
    /// where it lands. Segments belong to one sweep: across sweeps they are compared by the image class under them.
    fn as_shares_of_classes(&self, samples: &mut [Sample], pose: &Isometry3<f64>) {
        let (at, observations) = (self.projection(pose), &self.observations);
        samples.par_iter_mut().for_each(|sample| {
            let sampled = at.place(sample).map(|(_, pixel)| self.shares_under(sample, &pixel));
            let total = sampled.map_or(1.0, |sampled| sampled.total());
            if observations.frames[sample.frame as usize].partitions.is_some() {
                let under = sampled.as_ref().and_then(Sampled::largest);
                let class = under.map(|class| observations.num_point_classes + usize::from(class));
                sample.class = class.and_then(|class| u8::try_from(class).ok()).unwrap_or(sample.class);
            }
            sample.weight = (f64::from(sample.weight) / total) as f32;
        });
    }
}

/// Contributions of the frames, and of the point classes, to a sum over all points.
struct Shares<T> {
    of_frames: T,
    of_classes: T,
}

struct Problem<'a> {
    level: &'a Level,
    /// Points whose weights are shares of a class.
    samples: &'a [Sample],
    /// Pairs of the points that do not change.
    constant: &'a JointHistogram,
    near: &'a Neighbourhood<'a>,
    /// Number of variables.
    n: usize,
}

impl Problem<'_> {
    /// Contribution of each part to the gradient: one part is a frame, a square of its image, and a class. Points
    /// are chosen again, as at the end of the polish.
    fn scores(
        &self,
        here: &Projection<'_>,
        square_of: impl Fn(&Point2<f64>) -> [u32; 2],
    ) -> BTreeMap<[u32; 4], DVector<f64>> {
        let Placed { joint, mixed, .. } = self.placed(here);
        let (total, values) = (self.level.total(&joint), self.level.values(&joint));
        let mut sums: BTreeMap<[u32; 4], [f64; MAX_VARIABLES]> = BTreeMap::new();
        for mixed in mixed.iter().flatten() {
            let [row, column] = square_of(&mixed.pixel);
            let part = [mixed.sample.frame, row, column, u32::from(mixed.sample.class)];
            let map = self.level.maps[mixed.sample.frame as usize].as_ref();
            add_score(&map, mixed, here, &values, sums.entry(part).or_insert([0.0; MAX_VARIABLES]));
        }
        let score = |sum: [f64; MAX_VARIABLES]| DVector::from_column_slice(&sum[..self.n]) / total;
        sums.into_iter().map(|(part, sum)| (part, score(sum))).collect()
    }

    /// Contributions to the negative Hessian: differences of gradients along the steps, converted back to the
    /// variables by the inverse of the steps on the right.
    fn curvatures(&self, steps: &DMatrix<f64>) -> Option<Shares<Vec<DMatrix<f64>>>> {
        let along = |axis: usize| {
            let gradients =
                |by: f64| self.near.projection(&(steps.column(axis) * by)).ok().map(|at| self.gradients(&at));
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
            let count = differences.first().map_or(0, |shares| of(shares).ncols());
            let curvature = |place: usize| {
                let along: Vec<_> = differences.iter().map(|shares| of(shares).column(place)).collect();
                let curvature = DMatrix::from_columns(&along) * &inverse;
                0.5 * (&curvature + curvature.transpose())
            };
            (0..count).map(curvature).collect()
        };
        Some(Shares {
            of_frames: curvatures(|shares| &shares.of_frames),
            of_classes: curvatures(|shares| &shares.of_classes),
        })
    }

    fn placed<'p>(&self, at: &Projection<'p>) -> Placed<'p> {
        self.level.placed(self.samples, self.constant, at.clone(), Weights::WhereItLands)
    }

    /// Contributions to the gradient at some projection, with the points and weights chosen at the pose.
    fn gradients(&self, at: &Projection<'_>) -> Shares<DMatrix<f64>> {
        let observations = &self.level.observations;
        let of_images = if observations.has_partitions() { observations.num_image_classes } else { 0 };
        let num_classes = observations.num_point_classes + of_images;
        let mut of_frames = DMatrix::zeros(self.n, self.level.maps.len());
        let mut of_classes = DMatrix::zeros(self.n, num_classes);
        let placed = self.placed(at);
        for ((frame, class), gradient) in self.level.slopes(&placed, Split::FramesAndClasses) {
            of_frames.column_mut(frame).add_assign(&gradient);
            of_classes.column_mut(class).add_assign(&gradient);
        }
        let total = self.level.total(&placed.joint).max(1.0);
        Shares { of_frames: of_frames / total, of_classes: of_classes / total }
    }

    /// Steps, as columns, that each move the points by one block, root mean square, independently of one another.
    ///
    /// A shift of the principal point and the rotation that nearly cancels it become one strong and one weak motion,
    /// so that the curvature along the weak one is no small difference of large ones.
    fn unit_steps(&self, motions: &DMatrix<f64>, pose: &Isometry3<f64>) -> Option<DMatrix<f64>> {
        if self.n == 6 {
            let steps = self.level.preconditioner(self.samples, pose)?;
            return Some(DMatrix::from_fn(6, 6, |i, j| steps[(i, j)]));
        }
        let motions = motions / (self.level.factor as f64).powi(2);
        let longest: Vec<_> = (6..self.n).map(|axis| MAX_BLOCKS / motions[(axis, axis)].sqrt()).collect();
        longest.iter().all(|sigma| sigma.is_finite()).then(|| unit_steps(&motions, &longest)).flatten()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector6;

    use super::super::sample::Counted;
    use super::super::test_scene::scene;
    use super::*;
    use geometry::camera::Intrinsic;
    use geometry::se3;

    const CONFIG: SensitivityConfig =
        SensitivityConfig { factor: 1, max_points: usize::MAX, regions_across: 3 };

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
        let at_pose =
            sensitivity(&observations, &pose, &with_intrinsics(), &CONFIG).expect("points on labels");
        let level = Level::new(Arc::clone(&observations), &[], 1, usize::MAX);
        let samples = level.samples(&pose, Counted::Visible);
        let (_, gradient) =
            level.joint_and_gradient(&samples, &level.empty_joint(), &level.projection(&pose));
        assert!(at_pose.scores.nrows() > 4);
        let sum = at_pose.scores.row_sum().transpose();
        assert!((sum.fixed_rows::<6>(0) - &gradient).norm() < 1e-9 * gradient.norm(), "{sum} {gradient}");
        let of_pose =
            sensitivity(&observations, &pose, &Variables::default(), &CONFIG).expect("points on labels");
        assert!((of_pose.scores - at_pose.scores.columns(0, 6)).norm() < 1e-12);
        // Differences are taken along other steps, and the objective is only piecewise smooth.
        for axis in 0..6 {
            let ratio = at_pose.curvature[(axis, axis)] / of_pose.curvature[(axis, axis)];
            assert!((0.67..1.5).contains(&ratio), "axis {axis}: {ratio}");
        }
    }
}
