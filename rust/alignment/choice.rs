//! The choice of the points that count at a level.

use nalgebra::Isometry3;
use rayon::prelude::*;

use super::level::Level;
use super::pose::to_camera;
use super::sample::{Counted, Sample};
use crate::classes::NO_CLASS;
use crate::mutual_information::JointHistogram;
use crate::observation::Frame;
use crate::spherical::to_f64;
use crate::thinning::thinned;
use crate::visibility::{Projected, hidden, project_points};

impl Level {
    /// The labelled points on labelled pixels, with their weights at the anchor pose.
    pub fn samples(&self, pose: &Isometry3<f64>, counted: Counted) -> Vec<Sample> {
        let of_frame = |(index, frame): (usize, &Frame)| {
            let mut samples = Vec::new();
            for Projected { index: i, pixel, .. } in self.counted_points(frame, pose, counted) {
                let weight = self.maps[index].at(&pixel).total() as f32 * frame.weight;
                let position = to_f64(&frame.points[i]);
                let (class, frame_index, point) = (frame.point_classes[i], index as u32, i as u32);
                let sample = Sample { position, class, frame: frame_index, point, weight };
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
        let projected = project_points(camera, points, 0..points.len(), pose);
        let hidden = hidden(camera, points, &projected);
        let seen = projected.into_iter().zip(hidden).filter(|(point, hidden)| !hidden && counts[point.index]);
        seen.map(|(point, _)| point).collect()
    }

    /// Removes the points inside one class, whose pairs do not change while they move by less than `radius` blocks, and
    /// returns those pairs.
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
}
