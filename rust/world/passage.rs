//! The rig's way while one frame is measured.

use nalgebra::{Isometry3, Point3, Vector6};
use parry3d::math::Vec2;

use super::sensors::Rig;
use crate::error::{Error, Result};
use crate::se3::exp;

/// Spots that stand for a way lie no farther apart.
const SPOT_GAP_M: f64 = 0.5;
/// No rig is faster, metres or radians a second.
const MAX_RATE: f64 = 100.0;

/// How a rig passes through the scene of a frame. Times are seconds from the middle of the sweep.
#[derive(Clone, Debug)]
pub struct Passage {
    /// Its twist, metres and radians a second in the LiDAR frame; `None` if it stands still.
    twist_per_s: Option<Vector6<f64>>,
    /// The first and the last time at which something is measured.
    ends_s: [f64; 2],
}

impl Passage {
    /// Standing still.
    pub const STILL: Self = Self { twist_per_s: None, ends_s: [0.0; 2] };

    /// The passage of a rig with one twist.
    ///
    /// # Errors
    /// The twist is not finite, or no rig is as fast.
    pub fn new(twist_per_s: Vector6<f64>, rig: &Rig) -> Result<Self> {
        if !twist_per_s.iter().all(|rate| rate.abs() <= MAX_RATE) {
            let found: [f64; 6] = twist_per_s.into();
            return Err(Error::Input(format!(
                "found a twist of {found:?} a second, needed at most {MAX_RATE}"
            )));
        }
        let (half_sweep, shutter) = (0.5 * rig.lidar.sweep_s, &rig.shutter);
        let ends_s =
            [shutter.delay_s.min(-half_sweep), (shutter.delay_s + shutter.readout_s).max(half_sweep)];
        Ok(Self { twist_per_s: Some(twist_per_s), ends_s })
    }

    /// Whether the rig moves.
    pub fn is_moving(&self) -> bool {
        self.twist_per_s.is_some()
    }

    /// The LiDAR's pose in the world at a time, for its pose at time zero.
    pub fn carry(&self, t_world_lidar: &Isometry3<f64>, time_s: f64) -> Isometry3<f64> {
        // At rest the pose stays as it is to the bit.
        self.twist_per_s.map_or(*t_world_lidar, |twist| t_world_lidar * exp(&(twist * time_s)))
    }

    /// A point of the LiDAR's frame at one time, in its frame at another.
    pub fn seen_at(&self, point: Point3<f64>, from_s: f64, to_s: f64) -> Point3<f64> {
        self.twist_per_s.map_or(point, |twist| exp(&(twist * (from_s - to_s))) * point)
    }

    /// Spots of the LiDAR along the way, seen from above; the one at time zero is `spot`.
    pub fn spots(&self, spot: Vec2, t_world_lidar: &Isometry3<f64>) -> Vec<Vec2> {
        let Some(twist) = self.twist_per_s else { return vec![spot] };
        let [from, to] = self.ends_s;
        let steps = (twist.fixed_rows::<3>(0).norm() * (to - from) / SPOT_GAP_M).ceil().max(1.0) as usize;
        (0..=steps)
            .map(|step| from + (to - from) * step as f64 / steps as f64)
            .map(|time_s| self.carry(t_world_lidar, time_s).translation.vector.cast::<f32>())
            .map(|center| Vec2::new(center.x, center.y))
            .collect()
    }
}
