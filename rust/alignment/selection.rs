//! Choice of the points used at a level, among those that the camera may see near a pose.

use std::sync::Arc;

use geometry::camera::{Intrinsic, RUN};
use nalgebra::{Isometry3, Point2};
use rayon::prelude::*;

use super::level::{Level, touch, with_maps};
use super::projection::Projection;
use super::sample::{Counted, Sample};
use super::variables::Variables;
use crate::classes::Share;
use crate::mutual_information::JointHistogram;
use crate::observation::{Frame, Observations};
use crate::point_cloud::to_f64;
use crate::pyramid::{LabelMap, ShareMap};
use crate::visibility::{Projected, hidden, project_points};

/// Points at least this many blocks inside one class are summed up once by Newton's method. A round that moves them
/// farther is followed by another one, which chooses them again.
const CONSTANT_RADIUS: usize = 2;
/// Width of the band around the image in which points are kept, relative to the longer side.
const BAND: f64 = 0.5;

/// Observations without the points far outside the image at all of the given poses, and without the rows of their
/// segments, most of which are behind the camera.
///
/// Observations without partitions are unchanged, and so are frames whose points have class shares.
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
            partitions: frame.partitions.as_ref().map(|partitions| Arc::new(partitions.of_points(&points))),
            ..frame.clone()
        }
    };
    let frames = observations.frames.par_iter().map(of_frame).collect();
    Arc::new(observations.with_frames(frames))
}

/// The chosen points, split into those near other classes and the pairs of the rest, which are locally constant.
pub struct Selection {
    /// Points near other classes.
    pub moving: Vec<Sample>,
    /// Pairs of the remaining points.
    pub constant: JointHistogram,
    /// Number of the remaining points.
    pub num_constant: usize,
}

impl Level {
    /// Labelled points on labelled pixels, weighted at the anchor pose.
    pub fn samples(&self, pose: &Isometry3<f64>, counted: Counted) -> Vec<Sample> {
        self.select_where(pose, counted, |_, _, _| false).moving
    }

    /// The joint histogram of [`Level::samples`] at their anchor pose, and their number.
    pub fn joint_at(&self, pose: &Isometry3<f64>, counted: Counted) -> (JointHistogram, usize) {
        let Selection { constant, num_constant, .. } = self.select_where(pose, counted, |_, _, _| true);
        (constant, num_constant)
    }

    /// Selects points like [`Level::samples`], except that points at least `radius` blocks inside one class are only
    /// counted: their pairs do not change while they move by less.
    pub fn select(&self, pose: &Isometry3<f64>, counted: Counted, radius: usize) -> Selection {
        self.select_where(pose, counted, |map, pixel, _| map.only_class_around(pixel, radius).is_some())
    }

    /// Selects visible points like [`Level::select`] for Newton's method. Where it seeks the pose, alone or with cx, those
    /// of a frame's plain class are only counted, too.
    ///
    /// Their pairs change as the pose does, but they are chosen anew in each round, and at the maximum the points of all
    /// other classes pull the pose nowhere. Plain points hardly bend the information, but they are many and shake it:
    /// without them, what single frames of KITTI-360 pull scatters by 0.071 degrees instead of 0.54
    /// (docs/benchmarks_trust.md). Other intrinsics need them: without, a cy that is 22 pixels off is not seen on KITTI
    /// object. Where cx is 20 pixels off on KITTI raw, the frames ask for 609.9 with them and 610.3 without; 609.6 is
    /// right.
    pub fn select_for_newton(&self, pose: &Isometry3<f64>, variables: &Variables) -> Selection {
        let Variables { intrinsics, twists } = variables;
        let can_leave_out =
            twists.is_none() && intrinsics.iter().all(|&intrinsic| intrinsic == Intrinsic::Cx);
        let is_constant = |map: &ShareMap, pixel: &Point2<f64>, is_plain: bool| {
            (is_plain && can_leave_out) || map.only_class_around(pixel, CONSTANT_RADIUS).is_some()
        };
        self.select_where(pose, Counted::Visible, is_constant)
    }

    fn select_where(
        &self,
        pose: &Isometry3<f64>,
        counted: Counted,
        is_constant: impl Fn(&ShareMap, &Point2<f64>, bool) -> bool + Sync,
    ) -> Selection {
        with_maps!(&self.maps, maps => self.select_on(&maps, pose, counted, is_constant))
    }

    fn select_on(
        &self,
        maps: &[impl LabelMap],
        pose: &Isometry3<f64>,
        counted: Counted,
        is_constant: impl Fn(&ShareMap, &Point2<f64>, bool) -> bool + Sync,
    ) -> Selection {
        let of_frame = |(index, frame): (usize, &Frame)| {
            let map = self.maps[index].as_ref();
            let (mut moving, mut constant) = (Vec::new(), self.joint_of_frames(index..index + 1));
            let mut num_constant = 0;
            let points = self.counted_points(index, pose, counted);
            for (place, &Projected { index: i, pixel, .. }) in points.iter().enumerate() {
                if place % RUN == 0 {
                    let run = &points[place..(place + RUN).min(points.len())];
                    touch(maps, run.iter().map(|point| (index, &point.pixel)));
                }
                let sampled = maps[index].at(&pixel);
                let weight = sampled.total() as f32 * frame.weight;
                if weight <= 0.0 {
                    continue;
                }
                let mut add = |class: u8, weight: f32| {
                    if is_constant(map, &pixel, frame.plain_class == Some(class)) {
                        self.observations.for_rows(index, i, class, |row| {
                            sampled.add_to(constant.row_mut(row), f64::from(weight));
                        });
                        num_constant += 1;
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
            (moving, (constant, num_constant))
        };
        let (moving, of_frames): (Vec<Vec<Sample>>, Vec<(JointHistogram, usize)>) =
            self.observations.frames.par_iter().enumerate().map(of_frame).unzip();
        let (mut constant, mut num_constant) = (self.empty_joint(), 0);
        for (of_frame, num_of_frame) in &of_frames {
            constant.merge(of_frame);
            num_constant += num_of_frame;
        }
        Selection { moving: moving.concat(), constant, num_constant }
    }

    /// The labelled points of a frame that are inside the image and count, thinned.
    fn counted_points(&self, index: usize, pose: &Isometry3<f64>, counted: Counted) -> Vec<Projected> {
        let Observations { camera, origin, .. } = &*self.observations;
        let frame = &self.observations.frames[index];
        let used = || self.used_points(index).iter();
        let (points, hidden) = match counted {
            Counted::All => {
                let with_class = used().filter(|(point, _)| frame.has_class(*point));
                return project_points(camera, with_class, pose);
            }
            Counted::Visible if self.stride == 1 => frame.points.in_image(camera, pose, origin),
            // Thinned points hide one another over a wider spacing: on KITTI object, 7 to 18 % fewer of them are seen than
            // with all points, and searches end at the same maxima.
            Counted::Visible => {
                let points = project_points(camera, used(), pose);
                let hidden = hidden(camera, &frame.points, origin, &points);
                (points, Arc::new(hidden))
            }
        };
        // Points without a class still occlude others.
        let pairs = points.into_iter().zip(hidden.iter());
        let seen = pairs.filter(|(point, hidden)| !**hidden && frame.has_class(point.index));
        seen.map(|(point, _)| point).collect()
    }
}
