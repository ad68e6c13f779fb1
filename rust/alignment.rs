//! Mutual information over SE(3): its gradient at a pose, and a climb at one level of the label pyramid.
//!
//! Points share their pairs among the four blocks around them (partial volume), so that the joint histogram changes
//! smoothly with the pose. The points of a level are those on labelled pixels when the level begins, with the weights
//! that they have then, and while the lens still projects them they keep counting when they leave the picture, with the
//! class at the nearest border: a pose cannot raise the objective by pushing points out.

use nalgebra::{Isometry3, Matrix2x6, Matrix6, Vector3, Vector6};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::mutual_information::JointHistogram;
use crate::observation::{Frame, NO_CLASS, Observations};
use crate::pyramid::{Sampled, ShareMap};
use crate::se3;
use crate::spherical::to_f64;
use crate::thinning::{stride, thinned};

/// Decay rates of Adam's two moments (Kingma and Ba, arXiv 1412.6980).
const ADAM_DECAY: (f64, f64) = (0.9, 0.99);
const ADAM_EPSILON: f64 = 1e-12;
/// Pairs that a batch has not seen count as so many points: their pointwise mutual information has to be finite.
const LEAST_WEIGHT: f64 = 0.1;
/// So many points tell how a twist moves the picture.
const MAX_MOTION_POINTS: usize = 5000;
/// No unit motion is a longer translation than this share of the median range, however little it shows.
const LONGEST_MOTION: f64 = 0.05;
/// A level with fewer points than this tells nothing; the pose stays as it is.
const MIN_POINTS: usize = 50;

/// How the climb goes.
#[derive(Clone, Copy, Debug)]
pub struct AlignmentConfig {
    /// Side of a block of the label images, pixels.
    pub factor: usize,
    /// Steps to go.
    pub steps: usize,
    /// Points drawn for each step.
    pub batch_size: usize,
    /// Length of the first steps, in blocks; they fall along a cosine.
    pub step_size: f64,
    /// Share of the step length that is left at the end.
    pub final_step: f64,
    /// The camera stays within this distance of the LiDAR, metres: where labels hardly tell the translation, a climb would
    /// otherwise leave the rig.
    pub max_baseline: f64,
    /// The points are thinned to at most this number, over all frames and directions.
    pub max_points: usize,
}

/// Where a climb ended.
#[derive(Clone, Copy, Debug)]
pub struct Aligned {
    /// `T_camera_lidar`.
    pub pose: Isometry3<f64>,
    /// Mutual information of points and blocks there, nats, less its bias.
    pub mutual_information: f64,
    /// Labelled points on labelled blocks there.
    pub num_points: usize,
}

/// A labelled point on a labelled pixel.
#[derive(Clone, Copy, Debug)]
struct Sample {
    /// Metres, LiDAR frame.
    position: Vector3<f64>,
    class: u8,
    frame: u32,
    /// Labelled share of the blocks around it at the level's start.
    weight: f32,
}

/// Climbs the mutual information of all frames from each of the poses.
pub fn align(
    observations: &Observations,
    starts: &[Isometry3<f64>],
    config: &AlignmentConfig,
    seed: u64,
) -> Vec<Aligned> {
    let level = Level::new(observations, config);
    starts
        .par_iter()
        .map(|start| {
            let pose = level.climb(start, config, seed);
            level.assess(&pose)
        })
        .collect()
}

struct Level<'a> {
    observations: &'a Observations,
    /// Of each frame.
    maps: Vec<ShareMap>,
    factor: usize,
    /// Labelled points: position (metres, LiDAR frame), class and frame.
    points: Vec<(Vector3<f64>, u8, u32)>,
}

impl<'a> Level<'a> {
    fn new(observations: &'a Observations, config: &AlignmentConfig) -> Self {
        let frames = &observations.frames;
        let map = |frame: &Frame| {
            ShareMap::new(&frame.image_classes, observations.num_image_classes, config.factor)
        };
        let num_points: usize = frames.iter().map(|frame| frame.points.len()).sum();
        let stride = stride(num_points, config.max_points);
        let labelled = |(index, frame): (usize, &'a Frame)| {
            let point = move |i: usize| (to_f64(&frame.points[i]), frame.point_classes[i], index as u32);
            thinned(frame.points.len(), stride).map(point).filter(|&(_, class, _)| class != NO_CLASS)
        };
        Self {
            observations,
            maps: frames.par_iter().map(map).collect(),
            factor: config.factor,
            points: frames.iter().enumerate().flat_map(labelled).collect(),
        }
    }

    fn climb(&self, start: &Isometry3<f64>, config: &AlignmentConfig, seed: u64) -> Isometry3<f64> {
        let mut samples = self.samples(start);
        let start = &within_baseline(start, config.max_baseline);
        if samples.len() < MIN_POINTS {
            return *start;
        }
        samples.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
        // All of one size, or nearly: a last one with a handful of points would be noise.
        let num_batches = samples.len().div_ceil(config.batch_size);
        let mut batches = samples.chunks(samples.len().div_ceil(num_batches)).cycle();
        let Some(motions) = self.unit_motions(&samples, start) else {
            return *start;
        };
        let mut adam = Adam::default();
        let mut pose = *start;
        for step in 0..config.steps {
            let Some(batch) = batches.next() else { break };
            let gradient = self.gradient(batch, &pose);
            let cosine = 0.5 * (1.0 + (std::f64::consts::PI * step as f64 / config.steps as f64).cos());
            let length = config.step_size * (config.final_step + (1.0 - config.final_step) * cosine);
            let twist = motions * adam.step(&motions.tr_mul(&gradient)) * length;
            pose = within_baseline(&(se3::exp(&twist) * pose), config.max_baseline);
        }
        pose
    }

    /// The mutual information of the points that are on the picture now.
    fn assess(&self, pose: &Isometry3<f64>) -> Aligned {
        let samples = self.samples(pose);
        let to_camera = to_camera(pose);
        let mut joint = self.empty_joint();
        for sample in &samples {
            if let Some(pixel) = self.observations.camera.project(&to_camera(&sample.position)) {
                let sampled = self.maps[sample.frame as usize].at(&pixel);
                sampled.add_to(joint.row_mut(sample.class), f64::from(sample.weight));
            }
        }
        let mutual_information = joint.mutual_information() - joint.bias();
        Aligned { pose: *pose, mutual_information, num_points: samples.len() }
    }

    fn empty_joint(&self) -> JointHistogram {
        JointHistogram::new(self.observations.num_point_classes, self.observations.num_image_classes)
    }

    /// The points on labelled pixels.
    fn samples(&self, pose: &Isometry3<f64>) -> Vec<Sample> {
        let to_camera = to_camera(pose);
        let camera = &self.observations.camera;
        let sample = |&(position, class, frame): &(Vector3<f64>, u8, u32)| {
            let pixel = camera.project(&to_camera(&position)).filter(|pixel| camera.contains(pixel))?;
            let weight = self.maps[frame as usize].at(&pixel).total() as f32;
            (weight > 0.0).then_some(Sample { position, class, frame, weight })
        };
        self.points.iter().filter_map(sample).collect()
    }

    /// Six twists, as columns, that each move the points by one block, root mean square, independently of one another.
    ///
    /// A sideways translation and the rotation that nearly undoes it in the picture become one strong and one weak motion,
    /// and the climb goes along both at one pace instead of creeping along a valley between them. `None` where numbers
    /// overflow: nothing is a million kilometres away.
    fn unit_motions(&self, samples: &[Sample], pose: &Isometry3<f64>) -> Option<Matrix6<f64>> {
        let to_camera = to_camera(pose);
        let camera = &self.observations.camera;
        let mut moved = Matrix6::zeros();
        let mut ranges = Vec::new();
        for sample in samples.iter().take(MAX_MOTION_POINTS) {
            let p_camera = to_camera(&sample.position);
            if let Some((_, jacobian)) = camera.project_with_jacobian(&p_camera) {
                let mut motion = Matrix2x6::zeros();
                motion.fixed_columns_mut::<3>(0).copy_from(&jacobian);
                motion.fixed_columns_mut::<3>(3).copy_from(&(-jacobian * p_camera.cross_matrix()));
                moved += motion.tr_mul(&motion);
                ranges.push(p_camera.norm());
            }
        }
        moved /= ranges.len().max(1) as f64 * (self.factor as f64).powi(2);
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

    /// Gradient of the mutual information with respect to a twist on the left of the pose.
    ///
    /// `d MI = sum_i w_i / N sum_y pmi(x_i, y) d share_y(u_i)`, where the shares of a point add up to one: the terms from
    /// the marginals cancel.
    fn gradient(&self, batch: &[Sample], pose: &Isometry3<f64>) -> Vector6<f64> {
        let to_camera = to_camera(pose);
        let camera = &self.observations.camera;
        let mut joint = self.empty_joint();
        let mut at_edges = Vec::with_capacity(batch.len());
        for sample in batch {
            let p_camera = to_camera(&sample.position);
            let Some(pixel) = camera.project(&p_camera) else { continue };
            let sampled = self.maps[sample.frame as usize].at(&pixel);
            sampled.add_to(joint.row_mut(sample.class), f64::from(sample.weight));
            if let Sampled::Mixed(shares) = sampled
                && sampled.total() > 0.0
            {
                at_edges.push((sample, p_camera, shares));
            }
        }
        let pointwise = joint.pointwise_at_least(LEAST_WEIGHT);
        let mut gradient = Vector6::zeros();
        for (sample, p_camera, shares) in &at_edges {
            let Some((_, jacobian)) = camera.project_with_jacobian(p_camera) else { continue };
            let slope = shares.slope(&pointwise[joint.index(sample.class, 0)..]);
            let force: Vector3<f64> = jacobian.tr_mul(&slope) * f64::from(sample.weight);
            let torque = p_camera.cross(&force);
            gradient += Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z);
        }
        gradient / f64::max(joint.total(), 1.0)
    }
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

/// Steps of about unit length in the direction of a noisy gradient.
#[derive(Default)]
struct Adam {
    mean: Vector6<f64>,
    square: Vector6<f64>,
    steps: i32,
}

impl Adam {
    fn step(&mut self, gradient: &Vector6<f64>) -> Vector6<f64> {
        let (mean_decay, square_decay) = ADAM_DECAY;
        self.steps += 1;
        self.mean = self.mean * mean_decay + gradient * (1.0 - mean_decay);
        self.square = self.square * square_decay + gradient.component_mul(gradient) * (1.0 - square_decay);
        let mean = self.mean / (1.0 - mean_decay.powi(self.steps));
        let square = self.square / (1.0 - square_decay.powi(self.steps));
        mean.zip_map(&square, |m, s| m / (s.sqrt() + ADAM_EPSILON))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use crate::label_image::LabelImage;
    use proptest::prelude::*;

    const WIDTH: usize = 64;
    const HEIGHT: usize = 48;

    /// A picture of blobs, and points before it that carry the classes of their pixels at the identity.
    fn scene(shift: f64) -> Observations {
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
        let frame = Frame { points, point_classes, image_classes };
        Observations::new(camera, vec![frame], 3, 3).expect("valid observations")
    }

    fn config() -> AlignmentConfig {
        AlignmentConfig {
            factor: 4,
            steps: 60,
            batch_size: 500,
            step_size: 0.2,
            final_step: 0.05,
            max_baseline: 1.0,
            max_points: 10_000,
        }
    }

    proptest! {
        #[test]
        fn the_gradient_is_that_of_finite_differences(twist in prop::array::uniform6(-0.02..0.02f64)) {
            const STEP: f64 = 1e-7;
            // Points that cross the middle of a block within the step are left out: there the slope jumps.
            const FROM_MIDDLE: f64 = 1e-4;
            const TOLERANCE: f64 = 1e-4;
            let observations = scene(0.3);
            let level = Level::new(&observations, &config());
            let pose = se3::exp(&Vector6::from(twist));
            let mut samples = level.samples(&pose);
            samples.retain(|sample| {
                let pixel = observations.camera.project(&to_camera(&pose)(&sample.position)).expect("in front");
                [pixel.x, pixel.y].iter().all(|x| {
                    let place = ((x + 0.5) / level.factor as f64 - 0.5).rem_euclid(1.0);
                    place > FROM_MIDDLE && place < 1.0 - FROM_MIDDLE
                })
            });
            let value = |pose: &Isometry3<f64>| {
                let to_camera = to_camera(pose);
                let mut joint = level.empty_joint();
                for sample in &samples {
                    let pixel = observations.camera.project(&to_camera(&sample.position)).expect("in front");
                    level.maps[0].at(&pixel).add_to(joint.row_mut(sample.class), f64::from(sample.weight));
                }
                joint.mutual_information()
            };
            let gradient = level.gradient(&samples, &pose);
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
        let level = Level::new(&observations, &config());
        let pose = Isometry3::identity();
        let samples = level.samples(&pose);
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
    fn a_climb_finds_the_way_back() {
        let observations = scene(0.0);
        let config = AlignmentConfig { factor: 2, steps: 150, ..config() };
        let start = se3::exp(&Vector6::new(0.15, -0.1, 0.1, 0.03, -0.04, 0.05));
        let aligned = &align(&observations, &[start], &config, 0)[0];
        let error = |pose: &Isometry3<f64>| (pose.rotation.angle(), pose.translation.vector.norm());
        let ((angle, distance), (start_angle, start_distance)) = (error(&aligned.pose), error(&start));
        assert!(angle < 0.25 * start_angle && distance < 0.5 * start_distance, "{angle} {distance}");
    }

    #[test]
    fn the_camera_stays_within_the_baseline() {
        let observations = scene(0.0);
        let start = Isometry3::translation(0.3, 0.0, 0.0);
        let near = AlignmentConfig { max_baseline: 0.1, ..config() };
        let pose = align(&observations, &[start], &near, 0)[0].pose;
        assert!(pose.translation.vector.norm() <= 0.1 + 1e-12);
    }
}
