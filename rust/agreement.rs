//! Agreement of points and full-resolution label images at a pose: exact mutual information, label agreement,
//! overlap.

use std::collections::BTreeMap;

use geometry::camera::Camera;
use nalgebra::{Isometry3, Point2};
use rayon::prelude::*;

use crate::classes::NO_CLASS;
use crate::label_image::LabelImage;
use crate::mutual_information::JointHistogram;
use crate::observation::{Frame, Observations};
use crate::visibility::Projected;

/// Number of blocks along the longer side of the image that measure how much of it the points cover.
const COVER_BLOCKS: f64 = 40.0;

/// Square root of the number of clusters of pairs over all frames together. A cluster is a part of one frame's
/// image; the standard error of the mutual information is computed over the clusters.
const CLUSTERS_ACROSS: f64 = 8.0;

/// Weight, in points, of pairs that do not occur in the other observations.
const MIN_WEIGHT: f64 = 0.1;

/// Smallest standard error that a gain is divided by, nats: parts that gain alike have none.
const MIN_SIGMA: f64 = 1e-12;

#[derive(Clone, Debug)]
pub struct Agreement {
    /// Bilinear weights of the pairs that visible points form with the four pixels around them, over all frames.
    pub joint: JointHistogram,
    /// Contribution of each frame to `joint`.
    pub frame_joints: Vec<JointHistogram>,
    /// Number of labelled points inside the image.
    pub num_inside: usize,
    /// Number of these points that a nearer return occludes from the camera.
    pub num_hidden: usize,
    /// Share of the image's area that visible labelled points cover, averaged over frames.
    pub overlap: f64,
    /// Standard error of the mutual information over clusters, nats.
    pub sigma: f64,
}

impl Agreement {
    /// Share of the visible pairs with positive pointwise mutual information.
    pub fn label_agreement(&self) -> f64 {
        let pairs = self.joint.weights.iter().zip(self.joint.pointwise());
        // The empty sum of floats is minus zero.
        let agreeing = pairs.filter(|(_, pmi)| *pmi > 0.0).fold(0.0, |sum, (weight, _)| sum + weight);
        let total = self.joint.total();
        if total > 0.0 { agreeing / total } else { 0.0 }
    }
}

pub fn measure(observations: &Observations, t_camera_lidar: &Isometry3<f64>) -> Agreement {
    let frames = per_frame(observations, t_camera_lidar);
    let clusters: Vec<&JointHistogram> = frames.iter().flat_map(|frame| &frame.clusters).collect();
    let joint = merged(observations, &clusters);
    let of_frame = |frame: &FrameAgreement| merged(observations, &frame.clusters.iter().collect::<Vec<_>>());
    Agreement {
        frame_joints: frames.iter().map(of_frame).collect(),
        num_inside: frames.iter().map(|f| f.num_inside).sum(),
        num_hidden: frames.iter().map(|f| f.num_hidden).sum(),
        overlap: frames.iter().map(|f| f.overlap).sum::<f64>() / frames.len() as f64,
        sigma: standard_error(&joint, &by_scenes(observations, &frames)),
        joint,
    }
}

fn per_frame(observations: &Observations, t_camera_lidar: &Isometry3<f64>) -> Vec<FrameAgreement> {
    // Clusters of all scenes together are about as many, whatever the number of frames.
    let across = (CLUSTERS_ACROSS / (observations.num_scenes() as f64).sqrt()).ceil();
    let areas = Blocks::new(&observations.camera, across);
    let compare = |frame| FrameAgreement::new(observations, frame, t_camera_lidar, &areas);
    observations.frames.par_iter().map(compare).collect()
}

fn merged(observations: &Observations, clusters: &[&JointHistogram]) -> JointHistogram {
    let mut joint = JointHistogram::new(observations.num_point_classes, observations.num_image_classes);
    clusters.iter().for_each(|cluster| joint.merge(cluster));
    joint
}

/// Gain from one pose to another, nats.
#[derive(Clone, Copy, Debug)]
pub struct InformationGain {
    /// Mean gain over all pairs.
    pub gain: f64,
    /// Standard error of the gain over clusters; infinite if there are fewer than two.
    pub sigma: f64,
}

/// A pose with the observations evaluated there: those that provide the table, and those that are held out. Another
/// camera observes the same images and points differently.
#[derive(Clone, Copy)]
pub struct HeldOut<'a> {
    /// Observations that provide the table of pointwise mutual information.
    pub observations: &'a Observations,
    /// Held-out observations, which are evaluated with the table.
    pub held_out: &'a Observations,
    pub pose: &'a Isometry3<f64>,
}

/// Gain of held-out data from one pose to another, by the tables of pointwise mutual information of other
/// observations at each pose: the first term of the Donsker-Varadhan bound. Clusters are paired.
pub fn held_out_gain(before: HeldOut<'_>, after: HeldOut<'_>) -> InformationGain {
    let [before, after] = [before, after].map(|HeldOut { observations, held_out, pose }| {
        let table = measure(observations, pose).joint.pointwise_at_least(MIN_WEIGHT);
        let frames = per_frame(held_out, pose);
        let clusters: Vec<&JointHistogram> = frames.iter().flat_map(|frame| &frame.clusters).collect();
        let total = merged(held_out, &clusters).total().max(MIN_WEIGHT);
        sums(&by_scenes(held_out, &frames), |cluster| {
            cluster.weights.iter().zip(&table).map(|(weight, pmi)| weight * pmi).sum::<f64>() / total
        })
    });
    let pairs = before.values().zip(after.values()).filter(|(b, a)| **b != 0.0 || **a != 0.0);
    let gains: Vec<f64> = pairs.map(|(before, after)| after - before).collect();
    InformationGain::of_parts(gains)
}

impl InformationGain {
    /// The sum of the gains of independent parts.
    pub fn of_parts(gains: Vec<f64>) -> Self {
        // The empty sum of floats is minus zero.
        let (count, sum) = (gains.len() as f64, gains.iter().fold(0.0, |sum, gain| sum + gain));
        let scatter: f64 = gains.iter().map(|gain| (gain - sum / count).powi(2)).sum();
        let sigma = if gains.len() < 2 { f64::INFINITY } else { (scatter * count / (count - 1.0)).sqrt() };
        Self { gain: sum, sigma }
    }

    /// The gain in standard errors; 0 if they are infinite.
    pub fn significance(&self) -> f64 {
        self.gain / self.sigma.max(MIN_SIGMA)
    }
}

/// The number of the scene of a frame, and its clusters by their places in the image.
type SceneClusters<'a> = (u32, &'a [JointHistogram]);

fn by_scenes<'a>(observations: &Observations, frames: &'a [FrameAgreement]) -> Vec<SceneClusters<'a>> {
    let numbered = frames.iter().zip(0..);
    numbered.map(|(frame, number)| (observations.scene_of(number), frame.clusters.as_slice())).collect()
}

/// Sums a value of the clusters over the frames of each scene, by scene and place of the cluster.
fn sums(frames: &[SceneClusters<'_>], value: impl Fn(&JointHistogram) -> f64) -> BTreeMap<(u32, usize), f64> {
    let mut sums = BTreeMap::new();
    for (scene, clusters) in frames {
        for (place, cluster) in clusters.iter().enumerate() {
            *sums.entry((*scene, place)).or_default() += value(cluster);
        }
    }
    sums
}

/// Standard error of the mutual information. Pairs in a cluster are dependent, clusters of different scenes and places
/// are independent. A pair moves the estimate by the deviation of its pointwise mutual information from the mean.
fn standard_error(joint: &JointHistogram, frames: &[SceneClusters<'_>]) -> f64 {
    let (pointwise, mean, total) = (joint.pointwise(), joint.mutual_information(), joint.total());
    let influence = |cluster: &JointHistogram| {
        let pairs = cluster.weights.iter().zip(&pointwise).filter(|(weight, _)| **weight > 0.0);
        pairs.map(|(weight, pmi)| weight * (pmi - mean)).sum::<f64>() / total
    };
    let weights = sums(frames, JointHistogram::total);
    let influences = sums(frames, influence);
    let occupied = influences.values().zip(weights.values()).filter(|(_, weight)| **weight > 0.0);
    let (count, sum) = occupied.fold((0, 0.0), |(n, sum), (influence, _)| (n + 1, sum + influence.powi(2)));
    if count < 2 { f64::INFINITY } else { (sum * f64::from(count) / f64::from(count - 1)).sqrt() }
}

struct FrameAgreement {
    clusters: Vec<JointHistogram>,
    num_inside: usize,
    num_hidden: usize,
    overlap: f64,
}

impl FrameAgreement {
    fn new(
        observations: &Observations,
        frame: &Frame,
        t_camera_lidar: &Isometry3<f64>,
        areas: &Blocks,
    ) -> Self {
        let camera = &observations.camera;
        let (projected, hidden) = frame.points.in_image(camera, t_camera_lidar, &observations.origin);
        let empty = JointHistogram::new(observations.num_point_classes, observations.num_image_classes);
        let mut clusters = vec![empty; areas.count];
        let (mut num_inside, mut num_hidden) = (0, 0);
        let cover = Blocks::new(camera, COVER_BLOCKS);
        let mut covered = vec![false; cover.count];
        for (Projected { index, pixel, .. }, &hidden) in projected.iter().zip(hidden.iter()) {
            let class = frame.point_classes[*index];
            if class == NO_CLASS {
                continue;
            }
            num_inside += 1;
            num_hidden += usize::from(hidden);
            if !hidden {
                add_bilinear(&mut clusters[areas.at(pixel)], class, &frame.image.classes, pixel);
                covered[cover.at(pixel)] = true;
            }
        }
        let overlap = covered.iter().filter(|&&c| c).count() as f64 / cover.count as f64;
        Self { clusters, num_inside, num_hidden, overlap }
    }
}

/// Distributes a pair over the four pixels around a point, so that the histogram changes smoothly with the pose.
fn add_bilinear(joint: &mut JointHistogram, class: u8, image: &LabelImage<u8>, pixel: &Point2<f64>) {
    let (u, v) =
        (pixel.x.clamp(0.0, image.width as f64 - 1.0), pixel.y.clamp(0.0, image.height as f64 - 1.0));
    let (u0, v0) = (u as u32 as usize, v as u32 as usize);
    let (u1, v1) = ((u0 + 1).min(image.width - 1), (v0 + 1).min(image.height - 1));
    let [a, b, c, d] = [image.at(u0, v0), image.at(u1, v0), image.at(u0, v1), image.at(u1, v1)];
    if a == b && a == c && a == d {
        joint.add(class, a, 1.0);
        return;
    }
    let (du, dv) = (u - u0 as f64, v - v0 as f64);
    joint.add(class, a, (1.0 - du) * (1.0 - dv));
    joint.add(class, b, du * (1.0 - dv));
    joint.add(class, c, (1.0 - du) * dv);
    joint.add(class, d, du * dv);
}

/// Square blocks of the image, with the given number along its longer side.
struct Blocks {
    side: f64,
    columns: usize,
    count: usize,
}

impl Blocks {
    fn new(camera: &Camera, across: f64) -> Self {
        let side = camera.width.max(camera.height) as f64 / across;
        let blocks = |size: usize| (size as f64 / side).ceil() as usize;
        let columns = blocks(camera.width);
        Self { side, columns, count: columns * blocks(camera.height) }
    }

    /// Index of the block of a pixel inside the image.
    fn at(&self, pixel: &Point2<f64>) -> usize {
        // Conversions of 32 bits are faster than those of 64, and no image is that wide.
        let at = |x: f64| ((x + 0.5) / self.side) as u32 as usize;
        at(pixel.y) * self.columns + at(pixel.x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn diagonal(first: f64, second: f64) -> JointHistogram {
        let mut joint = JointHistogram::new(2, 2);
        joint.add(0, 0, first);
        joint.add(1, 1, second);
        joint
    }

    #[test]
    fn a_gain_is_significant_by_its_standard_errors() {
        // Parts of 1 and 3 scatter by 2 around their mean, summed and corrected for two.
        let gain = InformationGain::of_parts(vec![1.0, 3.0]);
        assert!((gain.significance() - 2.0).abs() < 1e-12);
        assert_eq!(InformationGain::of_parts(vec![5.0]).significance(), 0.0);
        assert!(InformationGain::of_parts(vec![1.0, 1.0]).significance() > 1e12);
        assert_eq!(InformationGain::of_parts(vec![0.0, 0.0]).significance(), 0.0);
    }

    #[test]
    fn the_standard_error_comes_from_the_differences_between_clusters() {
        // The pairs have pointwise information -log 3/4 and -log 1/4; their mean is the entropy.
        let clusters = [diagonal(6.0, 0.0), diagonal(0.0, 2.0)];
        let joint = diagonal(6.0, 2.0);
        let gap = 6.0 * (-(0.75f64.ln()) - joint.mutual_information()) / 8.0;
        let expected = (2.0 * (gap * gap + gap * gap)).sqrt();
        assert!((standard_error(&joint, &[(0, &clusters)]) - expected).abs() < 1e-12);
        let alike = [diagonal(3.0, 1.0), diagonal(3.0, 1.0)];
        assert!(standard_error(&joint, &[(0, &alike)]) < 1e-12);
        let one = [diagonal(6.0, 2.0)];
        assert_eq!(standard_error(&joint, &[(0, &one)]), f64::INFINITY);
        // Frames of one scene repeat one another, those of others do not.
        let twice = diagonal(12.0, 4.0);
        let error = |second| standard_error(&twice, &[(0, &clusters), (second, &clusters)]);
        assert!((error(0) - expected).abs() < 1e-12);
        assert!(error(1) < 0.8 * expected);
    }
}
