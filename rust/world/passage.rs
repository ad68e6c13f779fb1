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

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::super::layout;
    use super::super::scene::to_f32;
    use super::super::sensors::Lidar;
    use super::*;
    use crate::camera::Camera;
    use crate::shutter::Shutter;

    fn rig(shutter: Shutter) -> Rig {
        let k = [[320.0, 0.0, 319.5], [0.0, 320.0, 179.5], [0.0, 0.0, 1.0]];
        let axes = Matrix3::new(0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0);
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        let camera = Camera::new("plumb_bob", (640, 360), k, &[]).expect("a valid camera");
        let t_camera_lidar = Isometry3::from_parts(Vector3::new(0.0, -0.5, 0.0).into(), rotation);
        Rig { lidar: Lidar::default(), camera, t_camera_lidar, shutter }
    }

    /// The nearest thing above the ground that the LiDAR's rays meet from anywhere on its way.
    fn clearance(stage: &layout::Stage) -> f32 {
        let [from, to] = stage.passage.ends_s;
        let mut nearest = f32::MAX;
        for step in 0..=4 {
            let t = stage.t_world_lidar(from + (to - from) * f64::from(step) / 4.0);
            for i in 0..360 {
                for elevation in [-25f64, 0.0, 25.0] {
                    let (a, e) = (TAU * f64::from(i) / 360.0, elevation.to_radians());
                    let ray = to_f32(&Vector3::new(e.cos() * a.cos(), e.cos() * a.sin(), e.sin()));
                    let hit = stage.scene.cast(to_f32(&t.translation.vector), ray, 50.0, None);
                    nearest = hit.map_or(nearest, |hit| nearest.min(hit.range));
                }
            }
        }
        nearest
    }

    #[test]
    fn nothing_stands_in_the_way() {
        for seed in 0..24 {
            let delay_s = [0.0, 0.2, -0.2][seed as usize % 3];
            let shutter = Shutter { delay_s, readout_s: 0.1, ..Shutter::default() };
            let twist = Vector6::new(20.0, 0.0, 0.0, 0.0, 0.0, if seed % 2 == 0 { 0.4 } else { -0.4 });
            let passage = Passage::new(twist, &rig(shutter)).expect("a possible twist");
            let clear_m = clearance(&layout::build(ChaCha8Rng::seed_from_u64(seed), 0.0, passage));
            // The camera may be 1.5 m from the LiDAR.
            assert!(clear_m > 2.0, "seed {seed}: {clear_m} m");
        }
    }

    #[test]
    fn a_motion_that_no_rig_has_is_refused() {
        for rate in [f64::NAN, f64::INFINITY, 1e3] {
            assert!(Passage::new(Vector6::from_element(rate), &rig(Shutter::default())).is_err());
        }
    }
}
