//! The choice of the points that count at a level.

use nalgebra::{Isometry3, Point2};
use rayon::prelude::*;

use super::level::Level;
use super::sample::{Counted, Sample};
use crate::class_shares::Share;
use crate::classes::NO_CLASS;
use crate::mutual_information::JointHistogram;
use crate::observation::Frame;
use crate::point_cloud::to_f64;
use crate::pyramid::ShareMap;
use crate::thinning::thinned;
use crate::visibility::{Projected, project_points};

/// The points that count, apart from those whose pairs do not change while they move a little.
pub struct Chosen {
    /// Points near other classes.
    pub moving: Vec<Sample>,
    /// Pairs of the others.
    pub constant: JointHistogram,
}

impl Level {
    /// The labelled points on labelled pixels, with their weights at the anchor pose.
    pub fn samples(&self, pose: &Isometry3<f64>, counted: Counted) -> Vec<Sample> {
        self.choose(pose, counted, |_, _| false).moving
    }

    /// The same, but for the pairs of points that lie at least `radius` blocks inside one class: these do not change while
    /// points move by less.
    pub fn chosen(&self, pose: &Isometry3<f64>, counted: Counted, radius: usize) -> Chosen {
        self.choose(pose, counted, |map, pixel| map.is_amid_one_class(pixel, radius))
    }

    fn choose(
        &self,
        pose: &Isometry3<f64>,
        counted: Counted,
        is_constant: impl Fn(&ShareMap, &Point2<f64>) -> bool + Sync,
    ) -> Chosen {
        let of_frame = |(index, frame): (usize, &Frame)| {
            let map = &self.maps[index];
            let (mut moving, mut constant) = (Vec::new(), self.joint_of_frames(index..index + 1));
            for Projected { index: i, pixel, .. } in self.counted_points(frame, pose, counted) {
                let sampled = map.at(&pixel);
                let weight = sampled.total() as f32 * frame.weight;
                if weight <= 0.0 {
                    continue;
                }
                let is_constant = is_constant(map, &pixel);
                let mut add = |class: u8, weight: f32| {
                    if is_constant {
                        self.observations.for_rows(index, i, class, |row| {
                            sampled.add_to(constant.row_mut(row), f64::from(weight));
                        });
                    } else {
                        let (position, frame, point) = (to_f64(&frame.points[i]), index as u32, i as u32);
                        moving.push(Sample { position, class, frame, point, weight });
                    }
                };
                match &frame.point_shares {
                    None => add(frame.point_classes[i], weight),
                    // The joint histogram is linear in a point's shares: one sample for each of its classes.
                    Some(shares) => {
                        let of_class =
                            |share: &Share| add(share.class, f32::from(share.amount) / 255.0 * weight);
                        shares.at(i).iter().for_each(of_class);
                    }
                }
            }
            (moving, constant)
        };
        let (moving, of_frames): (Vec<Vec<Sample>>, Vec<JointHistogram>) =
            self.observations.frames.par_iter().enumerate().map(of_frame).unzip();
        let mut constant = self.empty_joint();
        of_frames.iter().for_each(|of_frame| constant.merge(of_frame));
        Chosen { moving: moving.concat(), constant }
    }

    /// The labelled points of a frame inside the image that count, thinned.
    fn counted_points(&self, frame: &Frame, pose: &Isometry3<f64>, counted: Counted) -> Vec<Projected> {
        let (camera, points) = (&self.observations.camera, &frame.points);
        let chosen = || thinned(points.len(), self.stride).filter(|&i| frame.point_classes[i] != NO_CLASS);
        if counted == Counted::All {
            return project_points(camera, points, chosen(), pose);
        }
        // Points that do not count hide others.
        let mut counts = vec![false; points.len()];
        chosen().for_each(|i| counts[i] = true);
        let (projected, hidden) = points.in_image(camera, pose);
        let pairs = projected.into_iter().zip(hidden.iter());
        let seen = pairs.filter(|(point, hidden)| !**hidden && counts[point.index]);
        seen.map(|(point, _)| point).collect()
    }
}
