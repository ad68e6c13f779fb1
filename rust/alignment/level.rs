//! One level of the label pyramid: the joint histogram of points at a pose, and its mutual information.

use std::hint::black_box;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

use geometry::camera::RUN;
use nalgebra::{Isometry3, Point2};
use rayon::prelude::*;

use super::adjusted::adjusted;
use super::objective::{Objective, contrast, signed};
use super::projection::Projection;
use super::sample::{Mixed, Sample, Weights};
use crate::classes::NO_CLASS;
use crate::mutual_information::JointHistogram;
use crate::observation::{Frame, Observations, PartitionRows};
use crate::pyramid::{AnyCorners, Corners, DenseMap, LabelMap, Sampled, ShareMap};
use crate::thinning::{stride, thinned};
use crate::visibility::project_points;

/// Weight, in points, of pairs not seen in a batch, which keeps their pointwise mutual information finite.
const MIN_WEIGHT: f64 = 0.1;
/// Number of points of a sweep that are projected to estimate how many are in the image.
const NUM_PROJECTED: usize = 4096;
/// Number of points that one task sums up, so that the order of the sums does not depend on the number of threads: at
/// least two tasks for a mini-batch of the refinement. With partitions, each task has a histogram of many rows.
const CHUNK: usize = 2048;
const CHUNK_WITH_PARTITIONS: usize = 8192;

/// Calls with the maps of all frames in the form that is fastest to read. Edges alone have eight levels; other cues, and
/// several together, take the general form.
macro_rules! with_maps {
    ($maps:expr, $name:ident => $call:expr) => {
        if let Some($name) = $crate::alignment::level::dense_maps::<{ $crate::pyramid::WORD }>($maps) {
            $call
        } else {
            let $name: Vec<&$crate::pyramid::ShareMap> = $maps.iter().map(|map| map.as_ref()).collect();
            $call
        }
    };
}
pub(super) use with_maps;

/// The label images of all frames in blocks, and the points that may project onto them.
#[derive(Clone, Debug)]
pub struct Level {
    pub(super) observations: Arc<Observations>,
    /// Label shares of each frame.
    pub(super) maps: Vec<Arc<ShareMap>>,
    /// Side of a block, pixels.
    pub(super) factor: usize,
    /// Stride between the points used.
    pub(super) stride: usize,
    /// The points used of each frame, gathered when they are first needed.
    pub(super) used: OnceLock<Vec<SomePoints>>,
    pub(super) objective: Objective,
}

impl Level {
    /// Creates a level with blocks of `factor` pixels, in which pixels along borders count little: see
    /// [`ShareMap`]. About `max_points` points are used, over all frames, of those that project into the images at
    /// the pose that sees the most of them.
    pub fn new(
        observations: Arc<Observations>,
        poses: &[Isometry3<f64>],
        factor: usize,
        max_points: usize,
    ) -> Self {
        let frames = &observations.frames;
        let map = |frame: &Frame| frame.image.level(factor, observations.edge_band_px);
        let maps = frames.par_iter().map(map).collect();
        let num_points: usize = frames.iter().map(|frame| frame.points.len()).sum();
        let stride =
            if num_points <= max_points { 1 } else { stride(num_in_image(&observations, poses), max_points) };
        Self { observations, maps, factor, stride, used: OnceLock::new(), objective: Objective::Information }
    }

    /// The points of a frame that are used, by its index.
    pub(super) fn used_points(&self, index: usize) -> &SomePoints {
        let frames = &self.observations.frames;
        let of_frame = |frame: &Frame| SomePoints::of(frame, self.stride);
        // In one thread: a task that rayon takes on meanwhile might wait here for its own thread.
        &self.used.get_or_init(|| frames.iter().map(of_frame).collect())[index]
    }

    /// Returns the projection of the points at a pose.
    pub(super) fn projection(&self, pose: &Isometry3<f64>) -> Projection<'static> {
        Projection::of_pose(&self.observations.camera, pose)
    }

    /// Joint histogram of the points' classes and the blocks that they project onto.
    pub fn joint(&self, samples: &[Sample], at: &Projection<'_>) -> JointHistogram {
        self.joint_and_mixed(samples, at, Weights::AtAnchor).0
    }

    /// Joint histogram of the points and, in chunks, the points on several classes, by which the histogram changes.
    pub(super) fn joint_and_mixed(
        &self,
        samples: &[Sample],
        at: &Projection<'_>,
        weights: Weights,
    ) -> (JointHistogram, Vec<Vec<Mixed>>) {
        with_maps!(&self.maps, maps => self.joint_and_mixed_on(&maps, samples, at, weights))
    }

    fn joint_and_mixed_on(
        &self,
        maps: &[impl LabelMap],
        samples: &[Sample],
        at: &Projection<'_>,
        weights: Weights,
    ) -> (JointHistogram, Vec<Vec<Mixed>>) {
        let of_chunk = |chunk: &[Sample]| {
            let (mut joint, mut mixed) = (self.joint_of(chunk), Vec::with_capacity(chunk.len()));
            let mut projected = Vec::with_capacity(RUN);
            for run in chunk.chunks(RUN) {
                projected.clear();
                projected.extend(run.iter().map(|sample| at.place(sample)));
                let pixels = run
                    .iter()
                    .zip(&projected)
                    .filter_map(|(sample, place)| Some((sample.frame as usize, &place.as_ref()?.1)));
                touch(maps, pixels);
                for (sample, place) in run.iter().zip(&projected) {
                    let &Some((p_camera, pixel)) = place else { continue };
                    let sampled = maps[sample.frame as usize].at(&pixel);
                    let sample = Sample { weight: weights.of(sample, &sampled), ..*sample };
                    self.add(&mut joint, &sample, &sampled);
                    if matches!(&sampled, Sampled::Mixed(shares) if shares.total() > 0.0) {
                        mixed.push(Mixed { sample, p_camera, pixel });
                    }
                }
            }
            (joint, mixed)
        };
        let size = if self.observations.has_partitions() { CHUNK_WITH_PARTITIONS } else { CHUNK };
        let (chunks, mixed): (Vec<JointHistogram>, Vec<_>) = samples.par_chunks(size).map(of_chunk).unzip();
        let mut joint = self.empty_joint();
        chunks.iter().for_each(|chunk| joint.merge(chunk));
        (joint, mixed)
    }

    /// Adds the shares under a sample to each of its rows.
    #[inline(always)]
    pub(super) fn add(&self, joint: &mut JointHistogram, sample: &Sample, sampled: &Sampled<impl Corners>) {
        let &Sample { class, frame, point, weight, .. } = sample;
        self.observations.for_rows(frame as usize, point as usize, class, |row| {
            sampled.add_to(joint.row_mut(row), f64::from(weight));
        });
    }

    /// Class shares under a pixel of a sample's frame.
    pub(super) fn shares_under(&self, sample: &Sample, pixel: &Point2<f64>) -> Sampled<AnyCorners<'_>> {
        self.maps[sample.frame as usize].as_ref().at(pixel)
    }

    pub fn empty_joint(&self) -> JointHistogram {
        JointHistogram::new(self.observations.num_rows, self.observations.num_image_classes)
    }

    /// Empty histogram with the rows of some neighbouring points.
    fn joint_of(&self, samples: &[Sample]) -> JointHistogram {
        let frames = samples.iter().map(|sample| sample.frame as usize);
        let (Some(first), Some(last)) = (frames.clone().min(), frames.max()) else {
            return self.empty_joint();
        };
        self.joint_of_frames(first..last + 1)
    }

    /// Empty histogram with the rows of some neighbouring frames.
    pub(super) fn joint_of_frames(&self, frames: Range<usize>) -> JointHistogram {
        let rows = self.observations.rows_of(frames);
        JointHistogram::of_rows(rows, self.observations.num_image_classes)
    }

    /// Mutual information of a joint histogram, nats; adjusted if there are partitions.
    pub fn information(&self, joint: &JointHistogram) -> f64 {
        if self.observations.has_partitions() { self.mean_value(joint) } else { joint.mutual_information() }
    }

    /// The objective of a joint histogram: the mutual information less its bias, or what has a sign.
    pub fn score(&self, joint: &JointHistogram) -> f64 {
        match &self.objective {
            Objective::Information => self.information(joint) - self.bias(joint),
            Objective::SignedInformation | Objective::Contrast(_) => self.mean_value(joint),
        }
    }

    fn mean_value(&self, joint: &JointHistogram) -> f64 {
        let total = self.total(joint);
        if total <= 0.0 {
            return 0.0;
        }
        let values = self.values_at_least(joint, 0.0);
        let pairs = joint.weights.iter().zip(&values.table);
        pairs.map(|(w, value)| if *w > 0.0 { w * value } else { 0.0 }).sum::<f64>() / total
    }

    /// Bias of [`Level::information`]. It is zero for partitions, since null partitions are as rich.
    pub fn bias(&self, joint: &JointHistogram) -> f64 {
        if self.observations.has_partitions() { 0.0 } else { joint.bias() }
    }

    pub(super) fn total(&self, joint: &JointHistogram) -> f64 {
        let of_nulls = |rows: PartitionRows| joint.rows(rows.nulls).iter().sum::<f64>();
        joint.total() - self.observations.partition_rows().map(of_nulls).sum::<f64>()
    }

    /// Contribution of each pair to the objective, finite even for pairs that were never seen.
    pub(super) fn values(&self, joint: &JointHistogram) -> PairValues<'_> {
        self.values_at_least(joint, MIN_WEIGHT)
    }

    fn values_at_least(&self, joint: &JointHistogram, floor: f64) -> PairValues<'_> {
        let num_levels = self.observations.num_image_classes;
        let table = match &self.objective {
            Objective::Information if self.observations.has_partitions() => {
                adjusted(joint, &self.observations, floor)
            }
            Objective::Information => joint.pointwise_at_least(floor),
            Objective::SignedInformation => signed(joint, num_levels, joint.pointwise_at_least(floor)),
            Objective::Contrast(weights) => contrast(joint, num_levels, weights),
        };
        PairValues { observations: &self.observations, table }
    }
}

/// The maps, if all blocks have `N` shares.
pub(super) fn dense_maps<const N: usize>(maps: &[Arc<ShareMap>]) -> Option<Vec<DenseMap<'_, N>>> {
    maps.iter().map(|map| map.dense()).collect()
}

/// Fetches the blocks under pixels of frames, given by their index, from memory.
pub(super) fn touch<'a>(maps: &[impl LabelMap], pixels: impl Iterator<Item = (usize, &'a Point2<f64>)>) {
    black_box(pixels.fold(0, |read, (frame, pixel)| read ^ maps[frame].touch(pixel)));
}

/// Number of points with a class inside the images of all frames, at the pose that sees the most of them, estimated from
/// some of them.
fn num_in_image(observations: &Observations, poses: &[Isometry3<f64>]) -> usize {
    let thinned_points = |frame: &Frame| {
        let stride = stride(frame.points.len(), NUM_PROJECTED);
        (stride, SomePoints::of(frame, stride))
    };
    let of_frames: Vec<_> = observations.frames.par_iter().map(thinned_points).collect();
    let num_seen = |pose| {
        let of_frame = |(frame, (stride, points)): (&Frame, &(usize, SomePoints))| {
            let with_class = points.iter().filter(|(point, _)| frame.has_class(*point));
            stride * project_points(&observations.camera, with_class, pose).len()
        };
        observations.frames.iter().zip(&of_frames).map(of_frame).sum()
    };
    poses.par_iter().map(num_seen).max().unwrap_or(0)
}

/// Some points of a sweep, side by side in memory: single points of a large sweep take many times longer to read.
#[derive(Clone, Debug)]
pub(super) struct SomePoints {
    indices: Vec<u32>,
    positions: Vec<[f32; 3]>,
}

impl SomePoints {
    /// Takes one of every `stride` points of a frame.
    fn of(frame: &Frame, stride: usize) -> Self {
        let indices = thinned(frame.points.len(), stride);
        let (indices, positions) = indices.map(|i| (i as u32, frame.points[i])).unzip();
        Self { indices, positions }
    }

    /// The points (metres, LiDAR frame) with their indices in the sweep.
    pub fn iter(&self) -> impl Iterator<Item = (usize, &[f32; 3])> {
        self.indices.iter().map(|&index| index as usize).zip(&self.positions)
    }
}

/// Contribution of each pair of a joint histogram: its pointwise mutual information, or its part of the adjusted
/// one.
pub(super) struct PairValues<'a> {
    observations: &'a Observations,
    table: Vec<f64>,
}

impl PairValues<'_> {
    /// Calls `with` with the value of each image class for a point.
    pub(super) fn of<T>(&self, sample: &Sample, with: impl FnOnce(&[f64]) -> T) -> T {
        let &Sample { class, frame, point, .. } = sample;
        let width = self.observations.num_image_classes;
        if self.observations.frames[frame as usize].partitions.is_none() {
            return with(&self.table[usize::from(class) * width..][..width]);
        }
        let mut sums = [0.0; NO_CLASS as usize];
        self.observations.for_rows(frame as usize, point as usize, class, |row| {
            let values = &self.table[row * width..][..width];
            sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
        });
        with(&sums[..width])
    }
}
