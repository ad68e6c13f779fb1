//! Mutual information along lines through a pose, over the points visible there: the data of a curve.

use std::sync::Arc;

use geometry::camera::RUN;
use geometry::se3;
use nalgebra::{Isometry3, Point2, Vector6};
use rayon::prelude::*;

use super::level::Level;
use super::projection::Projection;
use super::sample::{Counted, Sample};
use crate::classes::NO_CLASS;
use crate::mutual_information::JointHistogram;
use crate::observation::Observations;
use crate::pyramid::{AnyCorners, Sampled};

/// Radii (pixels) tried to find how far a point may move within one class.
const RADII: [usize; 5] = [2, 4, 8, 16, 32];
/// Tolerance (pixels) for the nonlinearity of the projection along a line.
const MARGIN_PX: f64 = 1.0;
/// Number of frames whose histograms are in memory at once.
const FRAMES_AT_ONCE: usize = 16;

#[derive(Clone, Debug)]
pub struct Line {
    /// Twist on the left of the pose, metres and radians.
    pub twist: Vector6<f64>,
    /// Multiples of the twist at the samples.
    pub offsets: Vec<f64>,
}

impl Line {
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
    lines: &[Line],
) -> Vec<Vec<f64>> {
    // As for the agreement, pixels along borders count in full.
    let mut observations = (**observations).clone();
    observations.edge_band_px = 0;
    let level = Level::new(Arc::new(observations), &[], 1, usize::MAX);
    let samples = level.samples(anchor, Counted::Visible);
    let none = |line: &Line| vec![level.empty_joint(); line.offsets.len()];
    let mut joints: Vec<Vec<JointHistogram>> = lines.iter().map(none).collect();
    // All samples of a frame one after another, while its label image is in the cache.
    let frames: Vec<&[Sample]> = samples.chunk_by(|a, b| a.frame == b.frame).collect();
    for frames in frames.chunks(FRAMES_AT_ONCE) {
        let of_frames: Vec<Vec<Vec<JointHistogram>>> =
            frames.par_iter().map(|samples| level.joints_along(samples, anchor, lines)).collect();
        for of_frame in &of_frames {
            let pairs = joints.iter_mut().flatten().zip(of_frame.iter().flatten());
            pairs.for_each(|(joint, more)| joint.merge(more));
        }
    }
    let information = |joint: &JointHistogram| level.information(joint);
    joints.iter().map(|of_line| of_line.iter().map(information).collect()).collect()
}

/// The neighbourhood of a point at the anchor.
#[derive(Clone, Copy, Debug)]
struct Interior {
    /// Projection of the point.
    pixel: Point2<f32>,
    /// The only class nearby; [`NO_CLASS`] where there are several.
    class: u8,
    /// Distance, pixels, that the point may move within that class.
    radius_px: f32,
}

impl Interior {
    const AMONG_CLASSES: Self = Self { pixel: Point2::new(0.0, 0.0), class: NO_CLASS, radius_px: 0.0 };
}

/// Points grouped by the length at which they first leave their class.
struct ExitLengths {
    /// Absolute offsets in ascending order.
    lengths: Vec<f64>,
    /// Indices of the points that are among several classes from each length on, but not before.
    moving: Vec<Vec<u32>>,
    /// Pairs of the points that are inside one class at each length.
    constant: Vec<JointHistogram>,
}

impl Level {
    fn interior(&self, sample: &Sample, here: &Projection<'_>) -> Interior {
        let Some((_, pixel)) = here.place(sample) else { return Interior::AMONG_CLASSES };
        let map = &self.maps[sample.frame as usize];
        let of_radius = |radius| {
            let class = map.only_class_around(&pixel, radius)?;
            Some(Interior { pixel: pixel.cast(), class, radius_px: radius as f32 })
        };
        RADII.into_iter().map_while(of_radius).last().unwrap_or(Interior::AMONG_CLASSES)
    }

    /// Joint histograms of the samples of one frame at each sample of the lines.
    fn joints_along(
        &self,
        samples: &[Sample],
        anchor: &Isometry3<f64>,
        lines: &[Line],
    ) -> Vec<Vec<JointHistogram>> {
        let here = self.projection(anchor);
        let interiors: Vec<Interior> = samples.iter().map(|sample| self.interior(sample, &here)).collect();
        let of_line = |line: &Line| {
            let exits = self.exit_lengths(samples, &interiors, anchor, line);
            let joint = |&offset: &f64| {
                let longest = exits.lengths.partition_point(|&length| length < offset.abs());
                let mut joint = exits.constant[longest].clone();
                let at = self.projection(&line.pose(anchor, offset));
                for indices in &exits.moving[..=longest] {
                    self.add_at(&mut joint, samples, indices, &at);
                }
                joint
            };
            line.offsets.iter().map(joint).collect()
        };
        lines.iter().map(of_line).collect()
    }

    fn exit_lengths(
        &self,
        samples: &[Sample],
        interiors: &[Interior],
        anchor: &Isometry3<f64>,
        line: &Line,
    ) -> ExitLengths {
        let mut lengths: Vec<f64> = line.offsets.iter().map(|offset| offset.abs()).collect();
        lengths.sort_by(f64::total_cmp);
        let farthest = lengths.last().copied().unwrap_or(0.0);
        let ends = [-farthest, farthest].map(|offset| self.projection(&line.pose(anchor, offset)));
        // The number of lengths at which a point stays inside its class: those that move it less than its radius.
        let count = |(sample, interior): (&Sample, &Interior)| {
            let allowed_px = f64::from(interior.radius_px) - MARGIN_PX;
            if allowed_px <= 0.0 {
                return 0;
            }
            let moved_px = |(_, pixel): (_, Point2<f64>)| (pixel - interior.pixel.cast()).amax();
            let most_px = ends.each_ref().map(|end| end.place(sample).map_or(f64::INFINITY, moved_px));
            let reach = farthest * allowed_px / most_px[0].max(most_px[1]);
            lengths.partition_point(|&length| length <= reach)
        };
        let counts = samples.iter().zip(interiors).map(count);
        let mut moving = vec![Vec::new(); lengths.len()];
        let mut constant = vec![self.empty_joint(); lengths.len()];
        for (index, count) in counts.enumerate() {
            if let Some(moving) = moving.get_mut(count) {
                moving.push(index as u32);
            }
            if count > 0 {
                self.add(
                    &mut constant[count - 1],
                    &samples[index],
                    &Sampled::<AnyCorners>::Uniform(interiors[index].class),
                );
            }
        }
        // A point that is inside one class at some length is so at all shorter lengths.
        for length in (1..lengths.len()).rev() {
            let (shorter, longer) = constant.split_at_mut(length);
            shorter[length - 1].merge(&longer[0]);
        }
        ExitLengths { lengths, moving, constant }
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
                    self.add(joint, sample, &self.shares_under(sample, pixel));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_scene::{scene, segmented};
    use super::*;
    use crate::agreement::measure;

    #[test]
    fn at_the_anchor_it_is_the_agreement_and_beside_the_truth_it_is_less() {
        let observations = scene(0.0);
        let anchor = Isometry3::identity();
        let line =
            Line { twist: Vector6::new(0.0, 0.0, 0.0, 1.0, 0.0, 0.0), offsets: vec![-0.01, 0.0, 0.01] };
        let information = &information_along(&observations, &anchor, &[line])[0];
        let there = measure(&observations, &anchor).joint.mutual_information();
        assert!((information[1] - there).abs() < 1e-6, "{information:?} {there}");
        assert!(information[0] < information[1] && information[2] < information[1], "{information:?}");
    }

    #[test]
    fn points_inside_one_class_count_as_if_they_were_looked_up_anew() {
        let anchor = se3::exp(&Vector6::new(0.02, -0.01, 0.03, 0.004, -0.003, 0.005));
        for observations in [scene(0.2), segmented(3)] {
            let level = Level::new(Arc::clone(&observations), &[], 1, usize::MAX);
            let samples = level.samples(&anchor, Counted::Visible);
            let lines: Vec<Line> = (0..6)
                .map(|axis| {
                    let offsets = vec![-0.1, -0.03, -0.001, 0.0, 0.01, 0.05, 0.1];
                    Line { twist: Vector6::ith(axis, 1.0), offsets }
                })
                .collect();
            let information = information_along(&observations, &anchor, &lines);
            for (line, information) in lines.iter().zip(information) {
                for (&offset, information) in line.offsets.iter().zip(information) {
                    let joint = level.joint(&samples, &level.projection(&line.pose(&anchor, offset)));
                    // The order of the sums differs.
                    assert!(
                        (information - level.information(&joint)).abs() < 1e-9,
                        "{line:?} {offset} {information}"
                    );
                }
            }
        }
    }
}
