//! Motion compensation (deskew): a sweep as the LiDAR would have seen it all at one time.
//!
//! A LiDAR with the pose `T(s)` in a fixed frame at time `s` measures a point `p` in its frame at that time. At the
//! time `m` the point is at `T(m)^-1 T(s) p`. Between two known poses the twist is constant.

use std::ops::RangeInclusive;

use geometry::se3::{exp, log};
use nalgebra::{Isometry3, Point3, Vector6};
use rayon::prelude::*;

use crate::error::{Error, Result};

/// Number of points that one task moves.
const CHUNK: usize = 4096;

/// Motion of a LiDAR in a fixed frame.
#[derive(Clone, Debug)]
pub struct Trajectory {
    /// Poses, sorted by time.
    knots: Vec<Knot>,
    /// The interval in which the motion is known.
    known: RangeInclusive<f64>,
}

/// A pose, and the motion from it to the next one.
#[derive(Clone, Debug)]
struct Knot {
    stamp: f64,
    pose: Isometry3<f64>,
    twist_per_s: Vector6<f64>,
}

impl Trajectory {
    /// Motion with a constant twist, metres and radians per second in the LiDAR frame. The fixed frame is that of
    /// the LiDAR at `stamp`, which should be close, since
    /// the twist is multiplied by the time from it.
    pub fn constant(twist_per_s: Vector6<f64>, stamp: f64) -> Self {
        let knot = Knot { stamp, pose: Isometry3::identity(), twist_per_s };
        Self { knots: vec![knot], known: f64::NEG_INFINITY..=f64::INFINITY }
    }

    /// Motion through poses of the LiDAR in a fixed frame.
    pub fn through(stamps: &[f64], poses: &[Isometry3<f64>]) -> Result<Self> {
        if stamps.len() != poses.len() {
            let found = format!("found {} poses at {} times", poses.len(), stamps.len());
            return Err(Error::Input(format!("{found}, expected one at each")));
        }
        let [start, .., end] = stamps else {
            return Err(Error::Input(format!("found {} poses, needed at least 2", poses.len())));
        };
        let mut knots = Vec::with_capacity(stamps.len());
        for (pair, ends) in stamps.windows(2).zip(poses.windows(2)) {
            let seconds = pair[1] - pair[0];
            if seconds.is_nan() || seconds <= 0.0 {
                let found = format!("found time {} after {}", pair[1], pair[0]);
                return Err(Error::Input(format!("{found}, expected times that ascend")));
            }
            let twist_per_s = log(&ends[0].inv_mul(&ends[1])) / seconds;
            knots.push(Knot { stamp: pair[0], pose: ends[0], twist_per_s });
        }
        Ok(Self { knots, known: *start..=*end })
    }

    /// The LiDAR's pose at a time, if it is known.
    pub fn pose_at(&self, stamp: f64) -> Option<Isometry3<f64>> {
        let knot = self.knot_before(stamp)?;
        Some(knot.pose * exp(&(knot.twist_per_s * (stamp - knot.stamp))))
    }

    /// The twist at a time, metres and radians per second in the LiDAR frame.
    pub fn twist_at(&self, stamp: f64) -> Option<Vector6<f64>> {
        self.knot_before(stamp).map(|knot| knot.twist_per_s)
    }

    fn knot_before(&self, stamp: f64) -> Option<&Knot> {
        let next = self.knots.partition_point(|knot| knot.stamp <= stamp);
        self.known.contains(&stamp).then(|| &self.knots[next.saturating_sub(1)])
    }

    /// Moves each point from the LiDAR frame at the point's own time to the one at `moment`, seconds.
    ///
    /// # Errors
    /// The first time that the trajectory does not cover.
    pub fn compensate(
        &self,
        points: &[[f32; 3]],
        times: &[f64],
        moment: f64,
    ) -> std::result::Result<Vec<[f32; 3]>, f64> {
        let to_moment = self.pose_at(moment).ok_or(moment)?.inverse();
        // Returns fired together share a time, and so do all points of a sweep that moves as a whole.
        let none = || (f64::NAN, Isometry3::identity());
        let moved = |(at, motion): &mut (f64, Isometry3<f64>), (point, &time): (&[f32; 3], &f64)| {
            if *at != time {
                (*at, *motion) = (time, to_moment * self.pose_at(time).ok_or(time)?);
            }
            Ok((*motion * Point3::from(*point).cast::<f64>()).cast::<f32>().into())
        };
        points.par_iter().zip(times).with_min_len(CHUNK).map_init(none, moved).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion, Vector3};

    fn turning() -> Vector6<f64> {
        Vector6::new(12.0, 0.3, -0.1, 0.02, -0.01, 0.4)
    }

    #[test]
    fn poses_of_a_constant_motion_say_the_same_as_its_twist() {
        let start = Isometry3::from_parts(
            Translation3::new(500.0, -20.0, 3.0),
            UnitQuaternion::from_scaled_axis(Vector3::new(0.1, -0.2, 2.0)),
        );
        let stamps = [-0.1, 0.03, 0.2];
        let poses = stamps.map(|t| start * exp(&(turning() * t)));
        let through = Trajectory::through(&stamps, &poses).expect("ascending");
        let (points, times) = ([[8.0, -3.0, 1.5], [-20.0, 1.0, 0.0]], [0.0, 0.1]);
        let by_poses = through.compensate(&points, &times, 0.15).expect("inside");
        let by_twist =
            Trajectory::constant(turning(), 0.0).compensate(&points, &times, 0.15).expect("always");
        for (a, b) in by_poses.iter().zip(&by_twist) {
            assert!((Point3::from(*a) - Point3::from(*b)).norm() < 1e-4, "{a:?} {b:?}");
        }
        assert_eq!(through.compensate(&points, &[0.0, 0.3], 0.15), Err(0.3));
        assert_eq!(through.compensate(&points, &[-0.2, 0.1], 0.15), Err(-0.2));
    }
}
