//! Whether the camera sees a LiDAR return.

use nalgebra::{Point3, Vector3};

use super::layout::Stage;
use super::scene::to_f32;
use super::sensors::Rig;

/// A return is hidden when something stands this much nearer on the camera's line of sight.
const HIDDEN_MARGIN_M: f64 = 0.1;
/// When a rolling shutter exposes a point is known if it changes by less than this share of a line's time.
const SETTLED_LINES: f64 = 0.1;
/// A point whose line is not found in so many steps passes the camera faster than the shutter rolls.
const MAX_STEPS: usize = 30;

/// Whether the camera sees a LiDAR return.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Visibility {
    /// It lies outside the picture.
    Outside,
    /// Something nearer stands before it.
    Hidden,
    /// It is in the picture and seen.
    Visible,
}

/// What a ray of the LiDAR met.
pub struct Target {
    /// When it was fired, seconds from the middle of the sweep.
    pub time_s: f64,
    /// Where it was measured, LiDAR frame of that time.
    pub measured: Vector3<f64>,
    /// Where it truly is, LiDAR frame of that time.
    pub truth: Vector3<f64>,
}

/// Whether a rig's camera sees a return, at the time at which the line of its place in the picture is exposed.
pub fn visibility(stage: &Stage, rig: &Rig, target: &Target) -> Visibility {
    let Some(time_s) = exposure_time_s(stage, rig, target) else { return Visibility::Outside };
    let camera_world = stage.t_world_lidar(time_s) * (rig.t_camera_lidar.inverse() * Point3::origin());
    let sight = stage.t_world_lidar(target.time_s) * Point3::from(target.truth) - camera_world;
    let limit = (sight.norm() - HIDDEN_MARGIN_M) as f32;
    let (eye, sight) = (to_f32(&camera_world.coords), to_f32(&sight.normalize()));
    match stage.scene.blocker(eye, sight, limit, None) {
        Some(_) => Visibility::Hidden,
        None => Visibility::Visible,
    }
}

/// When the camera exposes the place at which a return lies in its picture; `None` if it lies outside.
fn exposure_time_s(stage: &Stage, rig: &Rig, target: &Target) -> Option<f64> {
    let (camera, shutter) = (&rig.camera, &rig.shutter);
    let size = [camera.width, camera.height];
    let settled_s = SETTLED_LINES * shutter.readout_s / shutter.num_lines(size) as f64;
    let mut time_s = shutter.delay_s + 0.5 * shutter.readout_s;
    for _ in 0..MAX_STEPS {
        let seen = stage.passage.seen_at(target.measured.into(), target.time_s, time_s);
        let pixel = camera.project(&(rig.t_camera_lidar * seen).coords)?;
        let exposed_s = shutter.time_at_s(pixel.into(), size);
        if (exposed_s - time_s).abs() <= settled_s {
            return camera.contains(&pixel).then_some(time_s);
        }
        time_s = exposed_s;
    }
    None
}
