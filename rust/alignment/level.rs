//! One level of the label pyramid: which points count, and mutual information with its gradient at a pose.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::{Isometry3, Point2, Vector3, Vector6};
use rayon::prelude::*;

use super::adjusted::adjusted;
use super::pose::to_camera;
use super::sample::{ProjectedSample, Sample};
use super::sloped::{Motion, SlopedHistogram};
use crate::camera::RUN;
use crate::classes::NO_CLASS;
use crate::mutual_information::JointHistogram;
use crate::observation::{Frame, Observations, PartitionRows};
use crate::pyramid::{Sampled, ShareMap};
use crate::thinning::stride;

/// Weight, in points, of pairs that a batch has not seen: their pointwise mutual information has to be finite.
const LEAST_WEIGHT: f64 = 0.1;
/// Number of points that one task sums up, so that the order of the sums does not depend on the number of threads.
const CHUNK: usize = 8192;
/// The same without partitions, whose histograms are small: two tasks or more for a mini-batch of the refinement.
const SMALL_CHUNK: usize = 2048;

/// The label images of all frames in blocks, and the points that may project onto them.
#[derive(Clone, Debug)]
pub struct Level {
    pub(super) observations: Arc<Observations>,
    /// Label shares of each frame.
    pub(super) maps: Vec<Arc<ShareMap>>,
    /// Side of a block, pixels.
    pub(super) factor: usize,
    /// Step between the points that are used.
    pub(super) stride: usize,
}

impl Level {
    /// A level with blocks of `factor` pixels, in which pixels along borders count little: see [`ShareMap`]. At most
    /// `max_points` points, over all frames and directions, are used.
    pub fn new(
        observations: Arc<Observations>,
        factor: usize,
        edge_band_px: usize,
        max_points: usize,
    ) -> Self {
        let frames = &observations.frames;
        let map = |frame: &Frame| frame.image.level(factor, edge_band_px);
        let maps = frames.par_iter().map(map).collect();
        let num_points: usize = frames.iter().map(|frame| frame.points.len()).sum();
        let stride = stride(num_points, max_points);
        Self { observations, maps, factor, stride }
    }

    /// The joint histogram of the points' classes and of the blocks that they project onto.
    pub fn joint(&self, samples: &[Sample], pose: &Isometry3<f64>) -> JointHistogram {
        self.joint_and_mixed(samples, self.projection(pose), at_anchor, |_| ()).0
    }

    /// The joint histogram of `constant` pairs and those of the points, and the gradient of its mutual information with
    /// respect to a twist on the left of the pose, nats per metre and per radian.
    ///
    /// `d MI = sum_i w_i / N sum_y pmi(x_i, y) d share_y(u_i)`, where the shares of a point add up to one: the terms from
    /// the marginals cancel. With partitions it is the gradient of [`Level::information`].
    pub fn joint_and_gradient(
        &self,
        samples: &[Sample],
        constant: &JointHistogram,
        pose: &Isometry3<f64>,
    ) -> (JointHistogram, Vector6<f64>) {
        if self.observations.has_partitions() {
            return self.joint_and_gradient_by_point(samples, constant, pose);
        }
        let motion = |_: &Sample, p_camera: &Vector3<f64>, _: &Point2<f64>| self.motion::<8>(p_camera);
        let sloped = self.sloped(samples, self.projection(pose), at_anchor, motion);
        let joint = sloped.with(constant);
        let gradient = sloped.gradient(&joint.pointwise_at_least(LEAST_WEIGHT));
        let total = f64::max(joint.total(), 1.0);
        (joint, gradient.fixed_rows::<6>(1) / total)
    }

    fn joint_and_gradient_by_point(
        &self,
        samples: &[Sample],
        constant: &JointHistogram,
        pose: &Isometry3<f64>,
    ) -> (JointHistogram, Vector6<f64>) {
        let (mut joint, mixed) =
            self.joint_and_mixed(samples, self.projection(pose), at_anchor, |projected| projected);
        joint.merge(constant);
        let values = self.values(&joint);
        let of_chunk = |chunk: &Vec<ProjectedSample>| {
            let mut gradient = Vector6::zeros();
            for projected in chunk {
                let ProjectedSample { frame, weight, p_camera, pixel, .. } = projected;
                if let Sampled::Mixed(shares) = self.maps[*frame as usize].at(pixel) {
                    let per_pixel = values.of(projected, |values| shares.gradient(values));
                    let jacobian = self.observations.camera.jacobian(p_camera);
                    let force: Vector3<f64> = jacobian.tr_mul(&per_pixel) * f64::from(*weight);
                    let torque = p_camera.cross(&force);
                    gradient += Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z);
                }
            }
            gradient
        };
        let chunks: Vec<Vector6<f64>> = mixed.par_iter().map(of_chunk).collect();
        let gradient = chunks.iter().sum::<Vector6<f64>>() / f64::max(self.total(&joint), 1.0);
        (joint, gradient)
    }

    /// The histogram of points without partitions, with weights from `weigh`.
    pub(super) fn sloped<const WIDTH: usize>(
        &self,
        samples: &[Sample],
        projection: impl Fn(&Sample) -> Option<(Vector3<f64>, Point2<f64>)> + Sync,
        weigh: impl Fn(&Sample, &Sampled) -> f32 + Sync,
        motion: impl Fn(&Sample, &Vector3<f64>, &Point2<f64>) -> Motion<WIDTH> + Sync,
    ) -> SlopedHistogram<WIDTH> {
        let empty =
            || SlopedHistogram::new(self.observations.num_point_classes, self.observations.num_image_classes);
        let of_chunk = |chunk: &[Sample]| {
            let (mut sloped, mut projected) = (empty(), Vec::with_capacity(RUN));
            for run in chunk.chunks(RUN) {
                projected.clear();
                projected.extend(run.iter().map(&projection));
                for (sample, place) in run.iter().zip(&projected) {
                    let Some((p_camera, pixel)) = place else { continue };
                    let sampled = self.maps[sample.frame as usize].at(pixel);
                    let weight = f64::from(weigh(sample, &sampled));
                    sloped.add(sample.class, weight, &sampled, || motion(sample, p_camera, pixel));
                }
            }
            sloped
        };
        let chunks: Vec<SlopedHistogram<WIDTH>> = samples.par_chunks(SMALL_CHUNK).map(of_chunk).collect();
        let merged = chunks.into_iter().reduce(|mut sum, chunk| {
            sum.merge(&chunk);
            sum
        });
        merged.unwrap_or_else(empty)
    }

    /// A sample in the camera frame, and its pixel.
    pub(super) fn projection(
        &self,
        pose: &Isometry3<f64>,
    ) -> impl Fn(&Sample) -> Option<(Vector3<f64>, Point2<f64>)> + Sync {
        let to_camera = to_camera(pose);
        move |sample| {
            let p_camera = to_camera(&sample.position);
            self.observations.camera.project(&p_camera).map(|pixel| (p_camera, pixel))
        }
    }

    /// The joint histogram of points with weights from `weigh`; and, in chunks, the results of `keep` for the points on
    /// several classes, by which the histogram changes.
    pub(super) fn joint_and_mixed<T: Send>(
        &self,
        samples: &[Sample],
        projection: impl Fn(&Sample) -> Option<(Vector3<f64>, Point2<f64>)> + Sync,
        weigh: impl Fn(&Sample, &Sampled) -> f32 + Sync,
        keep: impl Fn(ProjectedSample) -> T + Sync,
    ) -> (JointHistogram, Vec<Vec<T>>) {
        let of_chunk = |chunk: &[Sample]| {
            let (mut joint, mut mixed) = (self.joint_of(chunk), Vec::new());
            for sample in chunk {
                let Some((p_camera, pixel)) = projection(sample) else { continue };
                let &Sample { class, frame, point, .. } = sample;
                let sampled = self.maps[frame as usize].at(&pixel);
                let weight = weigh(sample, &sampled);
                self.observations.for_rows(frame as usize, point as usize, class, |row| {
                    sampled.add_to(joint.row_mut(row), f64::from(weight));
                });
                if matches!(&sampled, Sampled::Mixed(shares) if shares.total() > 0.0) {
                    mixed.push(keep(ProjectedSample { class, frame, point, weight, p_camera, pixel }));
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
    pub(super) fn sampled(&self, sample: &Sample, p_camera: &Vector3<f64>) -> Option<Sampled<'_>> {
        let pixel = self.observations.camera.project(p_camera)?;
        Some(self.maps[sample.frame as usize].at(&pixel))
    }

    /// A histogram without pairs.
    pub fn empty_joint(&self) -> JointHistogram {
        JointHistogram::new(self.observations.num_rows, self.observations.num_image_classes)
    }

    /// A histogram without pairs, of the rows of some neighbouring points.
    fn joint_of(&self, samples: &[Sample]) -> JointHistogram {
        let frames = samples.iter().map(|sample| sample.frame as usize);
        let (Some(first), Some(last)) = (frames.clone().min(), frames.max()) else {
            return self.empty_joint();
        };
        self.joint_of_frames(first..last + 1)
    }

    /// A histogram without pairs, of the rows of some neighbouring frames.
    pub(super) fn joint_of_frames(&self, frames: Range<usize>) -> JointHistogram {
        let rows = self.observations.rows_of(frames);
        JointHistogram::of_rows(rows, self.observations.num_image_classes)
    }

    /// The mutual information of a joint histogram, nats; the adjusted one if there are partitions.
    pub fn information(&self, joint: &JointHistogram) -> f64 {
        let total = self.total(joint);
        if !self.observations.has_partitions() || total <= 0.0 {
            return joint.mutual_information();
        }
        let values = self.values_at_least(joint, 0.0);
        let pairs = joint.weights.iter().zip(&values.table);
        pairs.map(|(w, value)| if *w > 0.0 { w * value } else { 0.0 }).sum::<f64>() / total
    }

    /// How far [`Level::information`] lies above the truth. That of partitions does not: null ones are as rich.
    pub fn bias(&self, joint: &JointHistogram) -> f64 {
        if self.observations.has_partitions() { 0.0 } else { joint.bias() }
    }

    /// The weight of all points.
    pub(super) fn total(&self, joint: &JointHistogram) -> f64 {
        let of_nulls = |rows: PartitionRows| joint.rows(rows.nulls).iter().sum::<f64>();
        joint.total() - self.observations.partition_rows().map(of_nulls).sum::<f64>()
    }

    /// What each pair adds to the information, finite for pairs that were never seen.
    pub(super) fn values(&self, joint: &JointHistogram) -> Values<'_> {
        self.values_at_least(joint, LEAST_WEIGHT)
    }

    fn values_at_least(&self, joint: &JointHistogram, floor: f64) -> Values<'_> {
        let table = if self.observations.has_partitions() {
            adjusted(joint, &self.observations, floor)
        } else {
            joint.pointwise_at_least(floor)
        };
        Values { observations: &self.observations, table }
    }

    /// How the pixel of a point (camera frame) moves with a twist on the left of the pose, in the entries after the first.
    pub(super) fn motion<const WIDTH: usize>(&self, p_camera: &Vector3<f64>) -> Motion<WIDTH> {
        let jacobian = self.observations.camera.jacobian(p_camera);
        [0, 1].map(|row| {
            let force = jacobian.row(row).transpose();
            let torque = p_camera.cross(&force);
            let mut motion = [0.0; WIDTH];
            motion[1..4].copy_from_slice(force.as_slice());
            motion[4..7].copy_from_slice(torque.as_slice());
            motion
        })
    }
}

/// Pointwise mutual information of each pair of a joint histogram, or what it adds to the adjusted one.
pub(super) struct Values<'a> {
    observations: &'a Observations,
    table: Vec<f64>,
}

impl Values<'_> {
    /// The value of each pair of classes, where no point has partitions.
    pub(super) fn of_classes(&self) -> &[f64] {
        &self.table
    }

    /// Calls `with` with what each image class would add to the information under a point.
    #[inline]
    pub(super) fn of<T>(&self, projected: &ProjectedSample, with: impl FnOnce(&[f64]) -> T) -> T {
        let &ProjectedSample { class, frame, point, .. } = projected;
        let width = self.observations.num_image_classes;
        if self.observations.frames[frame as usize].partitions.is_none() {
            return with(&self.table[usize::from(class) * width..]);
        }
        let mut sums = [0.0; NO_CLASS as usize];
        self.observations.for_rows(frame as usize, point as usize, class, |row| {
            let values = &self.table[row * width..][..width];
            sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
        });
        with(&sums[..width])
    }
}

/// A sample's weight at the anchor pose, wherever it projects.
pub(super) fn at_anchor(sample: &Sample, _: &Sampled) -> f32 {
    sample.weight
}

#[cfg(test)]
mod tests {
    use super::super::choice::Chosen;
    use super::super::sample::Counted;
    use super::super::scene::{scene, segmented};
    use super::*;
    use crate::se3;
    use proptest::prelude::*;

    const FACTOR: usize = 4;

    proptest! {
        #[test]
        fn the_gradient_is_that_of_finite_differences(twist in prop::array::uniform6(-0.02..0.02f64)) {
            const STEP: f64 = 1e-7;
            // Points that cross the middle of a block within the step are left out: there the slope jumps.
            const FROM_MIDDLE: f64 = 1e-4;
            // Pairs of segments that weigh less than `LEAST_WEIGHT` have the slope of one that weighs as much.
            for (observations, tolerance) in [(scene(0.3), 1e-4), (segmented(2), 1e-2)] {
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
            let value = |pose: &Isometry3<f64>| level.information(&level.joint(&samples, pose));
            let gradient = level.joint_and_gradient(&samples, &level.empty_joint(), &pose).1;
            for axis in 0..6 {
                let mut step = Vector6::zeros();
                step[axis] = STEP;
                let slope = (value(&(se3::exp(&step) * pose)) - value(&(se3::exp(&-step) * pose))) / (2.0 * STEP);
                prop_assert!((slope - gradient[axis]).abs() < tolerance * (1.0 + gradient.norm()), "{axis}: {slope} {gradient}");
            }
            }
        }
    }

    #[test]
    fn points_amid_one_class_are_summed_up_once() {
        let observations = scene(0.0);
        let level = Level::new(Arc::clone(&observations), 1, 0, usize::MAX);
        let pose = Isometry3::identity();
        let all = level.samples(&pose, Counted::All);
        let Chosen { moving: left, constant } = level.chosen(&pose, Counted::All, 2);
        assert!(left.len() < all.len() && constant.total() > 0.0);
        // A third of a pixel away, nothing of what was taken out has changed.
        let nearby = se3::exp(&Vector6::new(0.0, 0.0, 0.0, 0.005, 0.0, 0.0)) * pose;
        let (whole, whole_gradient) = level.joint_and_gradient(&all, &level.empty_joint(), &nearby);
        let (split, split_gradient) = level.joint_and_gradient(&left, &constant, &nearby);
        assert!((whole.mutual_information() - split.mutual_information()).abs() < 1e-12);
        assert!((whole_gradient - split_gradient).norm() < 1e-9);
    }
}
