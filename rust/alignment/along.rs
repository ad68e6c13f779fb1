//! Mutual information along lines through a pose, over the points visible there: the data of a curve.

use std::sync::Arc;

use nalgebra::{Isometry3, Point2, Vector6};
use rayon::prelude::*;

use super::choice::{Counted, Sample};
use super::level::Level;
use super::projection::Projection;
use crate::camera::RUN;
use crate::classes::NO_CLASS;
use crate::mutual_information::JointHistogram;
use crate::observation::Observations;
use crate::pyramid::Sampled;
use crate::se3;

/// Radii (pixels) tried to find how far a point may move within one class.
const RADII: [usize; 5] = [2, 4, 8, 16, 32];
/// Tolerance (pixels) for the nonlinearity of the projection along a line.
const MARGIN_PX: f64 = 1.0;
/// Number of frames whose histograms are in memory at once.
const FRAMES_AT_ONCE: usize = 16;

#[derive(Clone, Debug)]
pub struct Way {
    /// Twist on the left of the pose, metres and radians.
    pub twist: Vector6<f64>,
    /// Multiples of the twist at the samples.
    pub offsets: Vec<f64>,
}

impl Way {
    fn pose(&self, anchor: &Isometry3<f64>, offset: f64) -> Isometry3<f64> {
        se3::exp(&(self.twist * offset)) * anchor
    }
}

/// Full-resolution mutual information at each sample of the lines, nats, over the points visible at the anchor.
///
/// Points keep the weights that they have at the anchor, so that only the pose changes along a line.
pub fn information_along(
    observations: &Arc<Observations>,
    anchor: &Isometry3<f64>,
    ways: &[Way],
) -> Vec<Vec<f64>> {
    let level = Level::new(Arc::clone(observations), 1, 0, usize::MAX);
    let samples = level.samples(anchor, Counted::Visible);
    let none = |way: &Way| vec![level.empty_joint(); way.offsets.len()];
    let mut joints: Vec<Vec<JointHistogram>> = ways.iter().map(none).collect();
    // All samples of a frame one after another, while its label image is in the cache.
    let frames: Vec<&[Sample]> = samples.chunk_by(|a, b| a.frame == b.frame).collect();
    for frames in frames.chunks(FRAMES_AT_ONCE) {
        let found: Vec<Vec<Vec<JointHistogram>>> =
            frames.par_iter().map(|samples| level.joints_along(samples, anchor, ways)).collect();
        for of_frame in &found {
            let pairs = joints.iter_mut().flatten().zip(of_frame.iter().flatten());
            pairs.for_each(|(joint, more)| joint.merge(more));
        }
    }
    let information = |joint: &JointHistogram| level.information(joint);
    joints.iter().map(|of_way| of_way.iter().map(information).collect()).collect()
}

/// The neighbourhood of a point at the anchor.
#[derive(Clone, Copy, Debug)]
struct Amid {
    /// Projection of the point.
    pixel: Point2<f32>,
    /// The only class nearby; [`NO_CLASS`] where there are several.
    class: u8,
    /// Distance, pixels, that the point may move within that class.
    radius_px: f32,
}

impl Amid {
    const AMONG_SEVERAL: Self = Self { pixel: Point2::new(0.0, 0.0), class: NO_CLASS, radius_px: 0.0 };
}

/// Points grouped by the length at which they first leave their class.
struct Leaving {
    /// Absolute offsets in ascending order.
    lengths: Vec<f64>,
    /// Indices of the points that are among several classes from each length on, but not before.
    moving: Vec<Vec<u32>>,
    /// Pairs of the points that are inside one class at each length.
    constant: Vec<JointHistogram>,
}

impl Level {
    fn amid(&self, sample: &Sample, here: &Projection<'_>) -> Amid {
        let Some((_, pixel)) = here.place(sample) else { return Amid::AMONG_SEVERAL };
        let map = &self.maps[sample.frame as usize];
        let Sampled::Uniform(class) = map.at(&pixel) else { return Amid::AMONG_SEVERAL };
        let within = RADII.into_iter().take_while(|&radius| map.is_amid_one_class(&pixel, radius));
        let of_radius = |radius| Amid { pixel: pixel.cast(), class, radius_px: radius as f32 };
        within.last().map_or(Amid::AMONG_SEVERAL, of_radius)
    }

    /// Joint histograms of the samples of one frame at each sample of the lines.
    fn joints_along(
        &self,
        samples: &[Sample],
        anchor: &Isometry3<f64>,
        ways: &[Way],
    ) -> Vec<Vec<JointHistogram>> {
        let here = self.at(anchor);
        let amid: Vec<Amid> = samples.iter().map(|sample| self.amid(sample, &here)).collect();
        let of_way = |way: &Way| {
            let leaving = self.leaving(samples, &amid, anchor, way);
            let joint = |&offset: &f64| {
                let longest = leaving.lengths.partition_point(|&length| length < offset.abs());
                let mut joint = leaving.constant[longest].clone();
                let at = self.at(&way.pose(anchor, offset));
                for indices in &leaving.moving[..=longest] {
                    self.add_at(&mut joint, samples, indices, &at);
                }
                joint
            };
            way.offsets.iter().map(joint).collect()
        };
        ways.iter().map(of_way).collect()
    }

    fn leaving(&self, samples: &[Sample], amid: &[Amid], anchor: &Isometry3<f64>, way: &Way) -> Leaving {
        let mut lengths: Vec<f64> = way.offsets.iter().map(|offset| offset.abs()).collect();
        lengths.sort_by(f64::total_cmp);
        let farthest = lengths.last().copied().unwrap_or(0.0);
        let ends = [-farthest, farthest].map(|offset| self.at(&way.pose(anchor, offset)));
        // The number of lengths at which a point stays inside its class: those that move it less than its radius.
        let count = |(sample, amid): (&Sample, &Amid)| {
            let allowed_px = f64::from(amid.radius_px) - MARGIN_PX;
            if allowed_px <= 0.0 {
                return 0;
            }
            let gone_px = |(_, pixel): (_, Point2<f64>)| (pixel - amid.pixel.cast()).amax();
            let most_px = ends.each_ref().map(|end| end.place(sample).map_or(f64::INFINITY, gone_px));
            let reach = farthest * allowed_px / most_px[0].max(most_px[1]);
            lengths.partition_point(|&length| length <= reach)
        };
        let counts = samples.iter().zip(amid).map(count);
        let mut moving = vec![Vec::new(); lengths.len()];
        let mut constant = vec![self.empty_joint(); lengths.len()];
        for (index, count) in counts.enumerate() {
            if let Some(moving) = moving.get_mut(count) {
                moving.push(index as u32);
            }
            if count > 0 {
                self.add(&mut constant[count - 1], &samples[index], &Sampled::Uniform(amid[index].class));
            }
        }
        // A point that is inside one class at some length is so at all shorter lengths.
        for length in (1..lengths.len()).rev() {
            let (shorter, longer) = constant.split_at_mut(length);
            shorter[length - 1].merge(&longer[0]);
        }
        Leaving { lengths, moving, constant }
    }

    /// Adds samples at their projections from a pose.
    fn add_at(&self, joint: &mut JointHistogram, samples: &[Sample], indices: &[u32], at: &Projection<'_>) {
        let mut projected = Vec::with_capacity(RUN);
        for run in indices.chunks(RUN) {
            projected.clear();
            projected.extend(run.iter().map(|&index| at.place(&samples[index as usize])));
            for (&index, place) in run.iter().zip(&projected) {
                let sample = &samples[index as usize];
                if let Some((_, pixel)) = place {
                    self.add(joint, sample, &self.under(sample, pixel));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::scene::{scene, segmented};
    use super::*;
    use crate::agreement::measure;

    #[test]
    fn at_the_anchor_it_is_the_agreement_and_beside_the_truth_it_is_less() {
        let observations = scene(0.0);
        let anchor = Isometry3::identity();
        let way = Way { twist: Vector6::new(0.0, 0.0, 0.0, 1.0, 0.0, 0.0), offsets: vec![-0.01, 0.0, 0.01] };
        let found = &information_along(&observations, &anchor, &[way])[0];
        let there = measure(&observations, &anchor).joint.mutual_information();
        assert!((found[1] - there).abs() < 1e-6, "{found:?} {there}");
        assert!(found[0] < found[1] && found[2] < found[1], "{found:?}");
    }

    #[test]
    fn points_amid_one_class_count_as_if_they_were_looked_up_anew() {
        let anchor = se3::exp(&Vector6::new(0.02, -0.01, 0.03, 0.004, -0.003, 0.005));
        for observations in [scene(0.2), segmented(3)] {
            let level = Level::new(Arc::clone(&observations), 1, 0, usize::MAX);
            let samples = level.samples(&anchor, Counted::Visible);
            let ways: Vec<Way> = (0..6)
                .map(|axis| {
                    let offsets = vec![-0.1, -0.03, -0.001, 0.0, 0.01, 0.05, 0.1];
                    Way { twist: Vector6::ith(axis, 1.0), offsets }
                })
                .collect();
            let found = information_along(&observations, &anchor, &ways);
            for (way, found) in ways.iter().zip(found) {
                for (&offset, found) in way.offsets.iter().zip(found) {
                    let joint = level.joint(&samples, &level.at(&way.pose(&anchor, offset)));
                    // The order of the sums differs.
                    assert!((found - level.information(&joint)).abs() < 1e-9, "{way:?} {offset} {found}");
                }
            }
        }
    }
}
