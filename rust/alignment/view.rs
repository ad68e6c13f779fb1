//! The part of the sweeps that a camera may see near a pose.

use std::sync::Arc;

use nalgebra::{Isometry3, Point2};
use rayon::prelude::*;

use super::projection::Projection;
use crate::observation::{Frame, Observations};
use crate::point_cloud::to_f64;

/// Width of the band around the picture from which points are kept, as a share of its longer side.
const BAND: f64 = 0.5;

/// Observations without the points that lie far outside of the picture at all of some poses, and without the rows of
/// their segments: most segments of a turn are behind the camera. Observations without partitions stay as they are, and
/// so do frames whose points have shares of classes.
pub(super) fn in_view(observations: &Arc<Observations>, poses: &[Isometry3<f64>]) -> Arc<Observations> {
    if !observations.has_partitions() {
        return Arc::clone(observations);
    }
    let camera = &observations.camera;
    let band = BAND * camera.width.max(camera.height) as f64;
    let views: Vec<Projection> = poses.iter().map(|pose| Projection::of_pose(camera, pose)).collect();
    let is_near = |pixel: Point2<f64>| {
        let within = |x: f64, size: usize| x > -band && x < size as f64 + band;
        within(pixel.x, camera.width) && within(pixel.y, camera.height)
    };
    let of_frame = |frame: &Frame| {
        if frame.point_shares.is_some() {
            return frame.clone();
        }
        let is_seen = |&point: &usize| {
            let position = to_f64(&frame.points[point]);
            views.iter().any(|at| at.place_of(&position, 0).is_some_and(|(_, pixel)| is_near(pixel)))
        };
        let points: Vec<usize> = (0..frame.points.len()).filter(is_seen).collect();
        Frame {
            points: Arc::new(points.iter().map(|&point| frame.points[point]).collect::<Vec<_>>().into()),
            point_classes: Arc::new(points.iter().map(|&point| frame.point_classes[point]).collect()),
            partitions: frame.partitions.as_ref().map(|each| Arc::new(each.of_points(&points))),
            ..frame.clone()
        }
    };
    let frames = observations.frames.par_iter().map(of_frame).collect();
    Arc::new(observations.with_frames(frames))
}
