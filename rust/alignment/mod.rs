//! Mutual information over SE(3): its value and gradient at a pose, at one level of the label pyramid (Alg. 1).
//!
//! Points share their pairs among the four blocks around them (partial volume), so that the joint histogram changes
//! smoothly with the pose. For discrete labels the Donsker-Varadhan bound is reached by
//! `F(x, y) = log p(x, y) / (p(x) p(y))`, a table, so this is the limit of MINE; for soft labels it is the mutual
//! information of ids drawn from the shares, a lower bound.
//!
//! Overlap: points are chosen at an anchor pose, with the weights that they have there. While the lens still projects
//! them they keep counting when they leave the picture, with the class at the nearest border: a pose cannot raise the
//! objective by pushing points out.

mod anchored;
mod climb;
mod polish;
mod sensitivity;

use std::sync::Arc;

use nalgebra::{Isometry3, Matrix2x6, Matrix6, Point2, Vector3, Vector6};
use rayon::prelude::*;

use crate::classes::NO_CLASS;
use crate::mutual_information::JointHistogram;
use crate::observation::{Frame, Observations};
use crate::pyramid::{Sampled, ShareMap};
use crate::spherical::to_f64;
use crate::thinning::{stride, thinned};
use crate::visibility::{hidden, land};

pub use anchored::Anchored;
pub use climb::{Aligned, AlignmentConfig, align};
pub use polish::{PolishConfig, Polished, polish};
pub use sensitivity::{Sensitivity, SensitivityConfig, sensitivity};

/// Pairs that a batch has not seen count as so many points: their pointwise mutual information has to be finite.
const LEAST_WEIGHT: f64 = 0.1;
/// So many points tell how a twist moves the picture.
const MAX_MOTION_POINTS: usize = 5000;
/// No unit motion is a longer translation than this share of the median range, however little it shows.
const LONGEST_MOTION: f64 = 0.05;
/// Points that one task sums up: whatever the number of threads, sums are in this order.
const CHUNK: usize = 8192;

/// Which labelled points of the picture count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counted {
    /// All.
    All,
    /// Those that no nearer return hides from the camera.
    Visible,
}

/// A labelled point on a labelled pixel.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Metres, LiDAR frame.
    position: Vector3<f64>,
    class: u8,
    frame: u32,
    /// Labelled share of the blocks around it at the anchor pose.
    weight: f32,
}

/// The label images of all frames in blocks, and the points that may land on them.
#[derive(Clone, Debug)]
pub struct Level {
    observations: Arc<Observations>,
    /// Of each frame.
    maps: Vec<ShareMap>,
    /// Side of a block, pixels.
    factor: usize,
    /// One point of so many is looked at.
    stride: usize,
}

/// A sample where it lands.
#[derive(Clone, Copy, Debug)]
struct Landed {
    class: u8,
    frame: u32,
    weight: f32,
    p_camera: Vector3<f64>,
    pixel: Point2<f64>,
}

/// The mutual information at a pose and where it grows.
#[derive(Clone, Debug)]
pub struct Slope {
    /// The pairs of all points.
    pub joint: JointHistogram,
    /// With respect to a twist on the left of the pose, nats per metre and per radian.
    pub gradient: Vector6<f64>,
}

impl Level {
    /// A level with blocks of `factor` pixels, in which pixels along borders count little: see [`ShareMap::new`]. Points
    /// are thinned to at most `max_points` over all frames and directions.
    pub fn new(observations: Arc<Observations>, factor: usize, edge_band: usize, max_points: usize) -> Self {
        let frames = &observations.frames;
        let map = |frame: &Frame| {
            ShareMap::new(&frame.image_classes, frame.image_shares.as_deref(), factor, edge_band)
        };
        let maps = frames.par_iter().map(map).collect();
        let num_points: usize = frames.iter().map(|frame| frame.points.len()).sum();
        let stride = stride(num_points, max_points);
        Self { observations, maps, factor, stride }
    }

    /// The labelled points on labelled pixels, with their weights: the anchor.
    pub fn samples(&self, pose: &Isometry3<f64>, counted: Counted) -> Vec<Sample> {
        let to_camera = to_camera(pose);
        let camera = &self.observations.camera;
        let of_frame = |(index, frame): (usize, &Frame)| {
            let hidden = match counted {
                Counted::All => Vec::new(),
                Counted::Visible => hidden(camera, &land(camera, &frame.points, pose)),
            };
            let seen = |i: &usize| frame.point_classes[*i] != NO_CLASS && !hidden.get(*i).is_some_and(|h| *h);
            let mut samples = Vec::new();
            for i in thinned(frame.points.len(), self.stride).filter(seen) {
                let position = to_f64(&frame.points[i]);
                let pixel = camera.project(&to_camera(&position)).filter(|pixel| camera.contains(pixel));
                let weight = pixel.map_or(0.0, |pixel| self.maps[index].at(&pixel).total() as f32);
                let sample = Sample { position, class: frame.point_classes[i], frame: index as u32, weight };
                match &frame.point_shares {
                    _ if weight <= 0.0 => {}
                    None => samples.push(sample),
                    // The joint histogram is linear in a point's shares: one sample for each of its classes.
                    Some(shares) => samples.extend(shares.at(i).iter().map(|share| {
                        let weight = f32::from(share.amount) / 255.0 * weight;
                        Sample { class: share.class, weight, ..sample }
                    })),
                }
            }
            samples
        };
        let frames: Vec<_> = self.observations.frames.par_iter().enumerate().map(of_frame).collect();
        frames.concat()
    }

    /// Takes out the points that lie amid one class, whose pairs do not change while they move by less than `radius`
    /// blocks, and returns those pairs.
    pub fn take_constant(
        &self,
        samples: &mut Vec<Sample>,
        pose: &Isometry3<f64>,
        radius: usize,
    ) -> JointHistogram {
        let to_camera = to_camera(pose);
        let is_constant = |sample: &Sample| {
            let pixel = self.observations.camera.project(&to_camera(&sample.position));
            pixel.is_some_and(|pixel| self.maps[sample.frame as usize].is_amid_one_class(&pixel, radius))
        };
        let constant: Vec<bool> = samples.par_iter().map(is_constant).collect();
        let of = |wanted: bool| {
            let pairs = samples.iter().zip(&constant).filter(move |&(_, &is_constant)| is_constant == wanted);
            pairs.map(|(sample, _)| *sample).collect::<Vec<_>>()
        };
        let (taken, left) = (of(true), of(false));
        *samples = left;
        self.joint(&taken, pose)
    }

    /// The joint histogram of the points' classes and the blocks on which they land.
    pub fn joint(&self, samples: &[Sample], pose: &Isometry3<f64>) -> JointHistogram {
        self.joint_and_mixed(samples, self.lands(pose), at_anchor, |_| ()).0
    }

    /// The joint histogram of `constant` pairs and those of the points, and the gradient of its mutual information with
    /// respect to a twist on the left of the pose.
    ///
    /// `d MI = sum_i w_i / N sum_y pmi(x_i, y) d share_y(u_i)`, where the shares of a point add up to one: the terms from
    /// the marginals cancel.
    pub fn slope(&self, samples: &[Sample], constant: &JointHistogram, pose: &Isometry3<f64>) -> Slope {
        let (mut joint, mixed) = self.joint_and_mixed(samples, self.lands(pose), at_anchor, |landed| landed);
        joint.merge(constant);
        let pointwise = joint.pointwise_at_least(LEAST_WEIGHT);
        let of_chunk = |chunk: &Vec<Landed>| {
            let mut gradient = Vector6::zeros();
            for Landed { class, frame, weight, p_camera, pixel } in chunk {
                if let Sampled::Mixed(shares) = self.maps[*frame as usize].at(pixel) {
                    let slope = shares.slope(&pointwise[joint.index(*class, 0)..]);
                    let jacobian = self.observations.camera.jacobian(p_camera);
                    let force: Vector3<f64> = jacobian.tr_mul(&slope) * f64::from(*weight);
                    let torque = p_camera.cross(&force);
                    gradient += Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z);
                }
            }
            gradient
        };
        let chunks: Vec<Vector6<f64>> = mixed.par_iter().map(of_chunk).collect();
        let gradient = chunks.iter().sum::<Vector6<f64>>() / f64::max(joint.total(), 1.0);
        Slope { joint, gradient }
    }

    /// Where a sample lies in the camera frame, and its pixel.
    fn lands(&self, pose: &Isometry3<f64>) -> impl Fn(&Sample) -> Option<(Vector3<f64>, Point2<f64>)> + Sync {
        let to_camera = to_camera(pose);
        move |sample| {
            let p_camera = to_camera(&sample.position);
            self.observations.camera.project(&p_camera).map(|pixel| (p_camera, pixel))
        }
    }

    /// The joint histogram of points weighed by `weigh`, and in chunks what `keep` makes of those on several classes, by
    /// which it changes.
    fn joint_and_mixed<T: Send>(
        &self,
        samples: &[Sample],
        lands: impl Fn(&Sample) -> Option<(Vector3<f64>, Point2<f64>)> + Sync,
        weigh: impl Fn(&Sample, &Sampled) -> f32 + Sync,
        keep: impl Fn(Landed) -> T + Sync,
    ) -> (JointHistogram, Vec<Vec<T>>) {
        let of_chunk = |chunk: &[Sample]| {
            let (mut joint, mut mixed) = (self.empty_joint(), Vec::new());
            for sample in chunk {
                let Some((p_camera, pixel)) = lands(sample) else { continue };
                let &Sample { class, frame, .. } = sample;
                let sampled = self.maps[frame as usize].at(&pixel);
                let weight = weigh(sample, &sampled);
                sampled.add_to(joint.row_mut(class), f64::from(weight));
                if matches!(&sampled, Sampled::Mixed(shares) if shares.total() > 0.0) {
                    mixed.push(keep(Landed { class, frame, weight, p_camera, pixel }));
                }
            }
            (joint, mixed)
        };
        let (chunks, mixed): (Vec<JointHistogram>, Vec<Vec<T>>) =
            samples.par_chunks(CHUNK).map(of_chunk).unzip();
        let mut joint = self.empty_joint();
        chunks.iter().for_each(|chunk| joint.merge(chunk));
        (joint, mixed)
    }

    #[inline]
    fn sampled(&self, sample: &Sample, p_camera: &Vector3<f64>) -> Option<Sampled<'_>> {
        let pixel = self.observations.camera.project(p_camera)?;
        Some(self.maps[sample.frame as usize].at(&pixel))
    }

    /// A histogram without pairs.
    pub fn empty_joint(&self) -> JointHistogram {
        JointHistogram::new(self.observations.num_point_classes, self.observations.num_image_classes)
    }

    /// Six twists, as columns, that each move the points by one block, root mean square, independently of one another.
    ///
    /// A sideways translation and the rotation that nearly undoes it in the picture become one strong and one weak motion,
    /// and the climb goes along both at one pace instead of creeping along a valley between them. `None` where numbers
    /// overflow: nothing is a million kilometres away.
    pub fn unit_motions(&self, samples: &[Sample], pose: &Isometry3<f64>) -> Option<Matrix6<f64>> {
        let to_camera = to_camera(pose);
        let camera = &self.observations.camera;
        let mut moved = Matrix6::zeros();
        let mut ranges = Vec::new();
        let step = samples.len().div_ceil(MAX_MOTION_POINTS).max(1);
        for sample in samples.iter().step_by(step) {
            let p_camera = to_camera(&sample.position);
            if let Some((_, jacobian)) = camera.project_with_jacobian(&p_camera) {
                let mut motion = Matrix2x6::zeros();
                motion.fixed_columns_mut::<3>(0).copy_from(&jacobian);
                motion.fixed_columns_mut::<3>(3).copy_from(&(-jacobian * p_camera.cross_matrix()));
                moved += motion.tr_mul(&motion);
                ranges.push(p_camera.norm());
            }
        }
        if ranges.is_empty() {
            return None;
        }
        moved /= ranges.len() as f64 * (self.factor as f64).powi(2);
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

/// A sample's weight at the anchor pose, wherever it lands.
fn at_anchor(sample: &Sample, _: &Sampled) -> f32 {
    sample.weight
}

/// Maps points from the LiDAR frame to the camera frame.
fn to_camera(pose: &Isometry3<f64>) -> impl Fn(&Vector3<f64>) -> Vector3<f64> {
    let (rotation, translation) = (*pose.rotation.to_rotation_matrix().matrix(), pose.translation.vector);
    move |point| rotation * point + translation
}

/// The pose with the camera's centre moved to the nearest place that is within `max_baseline` of the LiDAR.
fn within_baseline(pose: &Isometry3<f64>, max_baseline: f64) -> Isometry3<f64> {
    let scale = (max_baseline / pose.translation.vector.norm()).min(1.0);
    Isometry3::from_parts((pose.translation.vector * scale).into(), pose.rotation)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use crate::label_image::LabelImage;
    use crate::se3;
    use nalgebra::Matrix3x4;
    use proptest::prelude::*;

    const WIDTH: usize = 64;
    const HEIGHT: usize = 48;

    /// A picture of blobs, and points before it that carry the classes of their pixels at the identity.
    pub(super) fn scene(shift: f64) -> Arc<Observations> {
        let k = [[60.0, 0.0, 31.5], [0.0, 60.0, 23.5], [0.0, 0.0, 1.0]];
        let camera = Camera::new("plumb_bob", (WIDTH, HEIGHT), k, &[0.05, -0.01, 0.001, 0.002])
            .expect("a valid camera");
        let class = |u: f64, v: f64| {
            u8::from((u / 9.0 + shift).sin() + (v / 7.0).cos() > 0.2) + u8::from((u * v / 300.0).sin() > 0.6)
        };
        let pixels = (0..HEIGHT).flat_map(|v| (0..WIDTH).map(move |u| (u as f64, v as f64)));
        let ids = pixels.map(|(u, v)| class(u, v)).collect();
        let (mut points, mut point_classes) = (Vec::new(), Vec::new());
        for i in 0..900 {
            let pixel = nalgebra::Point2::new(f64::from(i % 30) * 2.1 + 0.3, f64::from(i / 30) * 1.55 + 0.4);
            if let Some(ray) = camera.unproject(&pixel) {
                let point = ray * (4.0 + f64::from(i % 7));
                points.push([point.x as f32, point.y as f32, point.z as f32]);
                point_classes.push(class(pixel.x, pixel.y));
            }
        }
        let image_classes = LabelImage { width: WIDTH, height: HEIGHT, ids };
        let frame = Frame {
            points: points.into(),
            point_classes: point_classes.into(),
            image_classes: image_classes.into(),
            point_shares: None,
            image_shares: None,
        };
        Arc::new(Observations::new(camera, vec![frame], 3, 3).expect("valid observations"))
    }

    const FACTOR: usize = 4;

    proptest! {
        #[test]
        fn the_gradient_is_that_of_finite_differences(twist in prop::array::uniform6(-0.02..0.02f64)) {
            const STEP: f64 = 1e-7;
            // Points that cross the middle of a block within the step are left out: there the slope jumps.
            const FROM_MIDDLE: f64 = 1e-4;
            const TOLERANCE: f64 = 1e-4;
            let observations = scene(0.3);
            let level = Level::new(Arc::clone(&observations), FACTOR, 0, usize::MAX);
            let pose = se3::exp(&Vector6::from(twist));
            let mut samples = level.samples(&pose, Counted::All);
            samples.retain(|sample| {
                let pixel = observations.camera.project(&to_camera(&pose)(&sample.position)).expect("in front");
                [pixel.x, pixel.y].iter().all(|x| {
                    let place = ((x + 0.5) / level.factor as f64 - 0.5).rem_euclid(1.0);
                    place > FROM_MIDDLE && place < 1.0 - FROM_MIDDLE
                })
            });
            let value = |pose: &Isometry3<f64>| level.joint(&samples, pose).mutual_information();
            let gradient = level.slope(&samples, &level.empty_joint(), &pose).gradient;
            for axis in 0..6 {
                let mut step = Vector6::zeros();
                step[axis] = STEP;
                let slope = (value(&(se3::exp(&step) * pose)) - value(&(se3::exp(&-step) * pose))) / (2.0 * STEP);
                prop_assert!((slope - gradient[axis]).abs() < TOLERANCE * (1.0 + gradient.norm()), "{axis}: {slope} {gradient}");
            }
        }
    }

    #[test]
    fn unit_motions_move_the_points_by_one_block_each() {
        let observations = scene(0.0);
        let level = Level::new(Arc::clone(&observations), FACTOR, 0, usize::MAX);
        let pose = Isometry3::identity();
        let samples = level.samples(&pose, Counted::All);
        let motions = level.unit_motions(&samples, &pose).expect("finite");
        const STEP: f64 = 1e-4;
        for motion in motions.column_iter() {
            let moved_pose = se3::exp(&(motion * STEP));
            let moved = to_camera(&moved_pose);
            let pixel = |p: &Vector3<f64>| observations.camera.project(p).expect("in front");
            let square = |s: &Sample| (pixel(&moved(&s.position)) - pixel(&s.position)).norm_squared();
            let mean = samples.iter().map(square).sum::<f64>() / samples.len() as f64;
            let blocks = mean.sqrt() / (STEP * level.factor as f64);
            // Less than one only where the longest translation limits it.
            assert!(blocks < 1.01 && blocks > 0.1, "{blocks}");
        }
    }

    #[test]
    fn points_amid_one_class_are_summed_up_once() {
        let observations = scene(0.0);
        let level = Level::new(Arc::clone(&observations), 1, 0, usize::MAX);
        let pose = Isometry3::identity();
        let all = level.samples(&pose, Counted::All);
        let mut left = all.clone();
        let constant = level.take_constant(&mut left, &pose, 2);
        assert!(left.len() < all.len() && constant.total() > 0.0);
        // A third of a pixel away, nothing of what was taken out has changed.
        let nearby = se3::exp(&Vector6::new(0.0, 0.0, 0.0, 0.005, 0.0, 0.0)) * pose;
        let (whole, split) =
            (level.slope(&all, &level.empty_joint(), &nearby), level.slope(&left, &constant, &nearby));
        assert!((whole.joint.mutual_information() - split.joint.mutual_information()).abs() < 1e-12);
        assert!((whole.gradient - split.gradient).norm() < 1e-9);
    }

    #[test]
    fn derivatives_of_shares_are_those_of_finite_differences() {
        const STEP: f64 = 1e-7;
        let observations = scene(0.3);
        let pose = se3::exp(&Vector6::new(0.01, -0.02, 0.01, 0.004, 0.003, -0.006));
        let points = Anchored::new(Arc::clone(&observations), FACTOR, 0, &pose, Counted::All);
        let indices: Vec<usize> = (0..points.classes().len()).step_by(37).collect();
        let weights: Vec<f64> = (0..indices.len() * 3).map(|i| (i as f64).sin()).collect();
        let matrix = pose.to_homogeneous().fixed_rows::<3>(0).into_owned();
        let value = |matrix: &Matrix3x4<f64>| {
            points.shares(&indices, matrix).iter().zip(&weights).map(|(a, b)| a * b).sum::<f64>()
        };
        let pulled = points.pull_back(&indices, &matrix, &weights);
        for entry in 0..12 {
            let mut step = Matrix3x4::zeros();
            step[entry] = STEP;
            let slope = (value(&(matrix + step)) - value(&(matrix - step))) / (2.0 * STEP);
            assert!(
                (slope - pulled[entry]).abs() < 1e-4 * (1.0 + pulled.norm()),
                "{entry}: {slope} {pulled}"
            );
        }
    }
}
