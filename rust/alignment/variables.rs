//! Variables that may be estimated with the pose: camera intrinsics and the time offset.

use std::sync::Arc;

use geometry::camera::{Camera, Intrinsic};
use geometry::se3;
use nalgebra::{DVector, Isometry3, Point3, Vector6};
use rayon::prelude::*;

use crate::error::Result;
use crate::observation::{Frame, Observations};

/// Largest number of variables: no camera has more.
pub const MAX_VARIABLES: usize = 27;

/// The variables of an estimate in order: the twist of the pose, intrinsics, and the time offset.
#[derive(Clone, Debug, Default)]
pub struct Variables {
    pub intrinsics: Vec<Intrinsic>,
    /// Twist of the LiDAR in each frame, metres and radians per second in its own frame. If given, the time offset
    /// of the images, seconds, is a variable.
    pub twists: Option<Vec<Vector6<f64>>>,
}

#[derive(Clone, Debug)]
pub struct Estimate {
    pub pose: Isometry3<f64>,
    pub camera: Camera,
    /// Time offset of the images, seconds; positive if they were taken later than stamped.
    pub offset_s: f64,
}

impl Variables {
    pub fn count(&self) -> usize {
        6 + self.intrinsics.len() + usize::from(self.twists.is_some())
    }

    /// Index of the time offset, if it is a variable.
    pub(super) fn offset(&self) -> Option<usize> {
        self.twists.is_some().then(|| self.count() - 1)
    }

    /// Intrinsics with their values in a vector of all variables.
    pub(super) fn intrinsics_in<'a>(
        &'a self,
        values: &'a DVector<f64>,
    ) -> impl Iterator<Item = (Intrinsic, f64)> + 'a {
        self.intrinsics.iter().copied().zip(values.iter().skip(6).copied())
    }
}

impl Estimate {
    /// The estimate after a change of the variables.
    pub fn changed(&self, variables: &Variables, change: &DVector<f64>, max_baseline_m: f64) -> Result<Self> {
        Ok(Self {
            pose: within_baseline(&moved(&self.pose, change), max_baseline_m),
            camera: self.camera.changed(variables.intrinsics_in(change))?,
            offset_s: self.offset_s + variables.offset().map_or(0.0, |index| change[index]),
        })
    }

    /// Observations with the camera of this estimate, and with the points where the LiDAR would have seen them when
    /// the images were taken.
    pub fn observed(&self, observations: &Observations, variables: &Variables) -> Arc<Observations> {
        let mut seen = observations.clone();
        seen.camera = self.camera.clone();
        if let (Some(twists), true) = (&variables.twists, self.offset_s != 0.0) {
            let of_frame = |(frame, twist): (&Frame, &Vector6<f64>)| {
                let motion = motion_over(twist, self.offset_s);
                let point =
                    |point: &[f32; 3]| (motion * Point3::from(*point).cast::<f64>()).cast::<f32>().into();
                let points: Vec<[f32; 3]> = frame.points.iter().map(point).collect();
                Frame { points: Arc::new(points.into()), ..frame.clone() }
            };
            seen.frames = observations.frames.par_iter().zip(twists).map(of_frame).collect();
        }
        Arc::new(seen)
    }
}

/// Motion of points of the LiDAR frame to its frame some seconds later.
pub(super) fn motion_over(twist_per_s: &Vector6<f64>, seconds: f64) -> Isometry3<f64> {
    se3::exp(&(twist_per_s * -seconds))
}

/// `T_camera_lidar` moved by the twist in a change of all variables.
pub(super) fn moved(pose: &Isometry3<f64>, change: &DVector<f64>) -> Isometry3<f64> {
    se3::exp(&change.fixed_rows::<6>(0).into_owned()) * pose
}

/// The pose with the camera centre moved to the nearest place within `max_baseline_m` of the LiDAR.
pub(super) fn within_baseline(pose: &Isometry3<f64>, max_baseline_m: f64) -> Isometry3<f64> {
    let scale = (max_baseline_m / pose.translation.vector.norm()).min(1.0);
    Isometry3::from_parts((pose.translation.vector * scale).into(), pose.rotation)
}
