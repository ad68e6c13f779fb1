//! The rig: a LiDAR with its firing pattern and flaws, a camera next to it, and the rig's path while one frame is
//! measured.

use std::f64::consts::TAU;

use geometry::Invalid;
use geometry::angles::from_angles;
use geometry::camera::Camera;
use geometry::se3::exp;
use geometry::shutter::Shutter;
use nalgebra::{Isometry3, Point3, Vector3, Vector6};
use parry3d::math::Vec2;

/// Turns of a rosette about z, and swings between its lowest and highest angle, per [`ROSETTE_PERIOD`] points.
/// Neither ratio is rational, so the pattern never repeats.
const ROSETTE_TURNS: f64 = 20.0 * 1.618_033_988_749_895;
const ROSETTE_SWINGS: f64 = 700.0 * std::f64::consts::SQRT_2;
const ROSETTE_PERIOD: f64 = 20_000.0;

/// How a LiDAR's rays cover its field of view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pattern {
    /// Channels evenly spaced in elevation, at evenly spaced azimuths; column by column, from the top.
    Spinning,
    /// A rosette all around the z axis, like that of a Livox Mid-360: the ray swings in elevation while it turns,
    /// and never repeats a line, so that every frame has other rays. It is not a grid.
    Rosette,
}

/// A LiDAR: its ray directions in its own frame (x forward, y left, z up), in firing order, and its flaws.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lidar {
    /// How the rays cover the field of view.
    pub pattern: Pattern,
    /// Number of beams.
    pub channels: usize,
    /// Columns of a turn. The first points along x, the next to its left. A rosette has the same number of rays.
    pub columns: usize,
    /// Elevation of the highest ray.
    pub fov_up_deg: f64,
    /// Elevation of the lowest ray.
    pub fov_down_deg: f64,
    /// Standard deviation of a range.
    pub range_noise_m: f64,
    /// Fraction of the returns that are lost.
    pub dropout: f64,
    /// Maximum range of a return.
    pub max_range_m: f64,
    /// Duration of a sweep.
    pub sweep_s: f64,
    /// Pitch of the sensor's x axis below that of the vehicle. The camera is mounted on the LiDAR and tilts with
    /// it.
    pub tilt_deg: f64,
}

/// A spinning LiDAR of 64 channels.
impl Default for Lidar {
    fn default() -> Self {
        Self {
            pattern: Pattern::Spinning,
            channels: 64,
            columns: 800,
            fov_up_deg: 10.0,
            fov_down_deg: -30.0,
            range_noise_m: 0.02,
            dropout: 0.05,
            max_range_m: 120.0,
            sweep_s: 0.1,
            tilt_deg: 0.0,
        }
    }
}

impl Lidar {
    /// The unit vectors of one frame's rays.
    pub fn directions(&self, frame: u64) -> Vec<Vector3<f64>> {
        let Self { pattern, channels, columns, fov_up_deg, fov_down_deg, .. } = *self;
        let points = channels * columns;
        match pattern {
            Pattern::Spinning => {
                let step = (fov_up_deg - fov_down_deg) / (channels.max(2) - 1) as f64;
                let elevation = |channel: usize| (fov_up_deg - step * channel as f64).to_radians();
                let azimuth = |column: usize| TAU * column as f64 / columns as f64;
                (0..points)
                    .map(|ray| from_angles(azimuth(ray / channels), elevation(ray % channels)))
                    .collect()
            }
            Pattern::Rosette => {
                let middle = 0.5 * (fov_up_deg + fov_down_deg);
                let swing = 0.5 * (fov_up_deg - fov_down_deg);
                let first = frame as f64 * points as f64;
                (0..points)
                    .map(|i| (first + i as f64) / ROSETTE_PERIOD)
                    .map(|t| {
                        let elevation = middle + swing * (TAU * (t * ROSETTE_SWINGS).fract()).sin();
                        from_angles(TAU * (t * ROSETTE_TURNS).fract(), elevation.to_radians())
                    })
                    .collect()
            }
        }
    }

    /// Fraction of the sweep that has passed when a ray is fired. The rays of a column are fired together.
    pub(crate) fn share_before(&self, ray: usize) -> f64 {
        match self.pattern {
            Pattern::Spinning => (ray / self.channels) as f64 / self.columns as f64,
            Pattern::Rosette => ray as f64 / (self.channels * self.columns) as f64,
        }
    }

    fn is_valid(&self) -> bool {
        let amounts = [self.range_noise_m, self.max_range_m, self.sweep_s];
        let sound = amounts.iter().all(|&x| x.is_finite() && x >= 0.0);
        let is_field = (-90.0..=90.0).contains(&self.fov_down_deg)
            && (self.fov_down_deg..=90.0).contains(&self.fov_up_deg);
        let has_rays = self.channels * self.columns > 0;
        sound && (0.0..=1.0).contains(&self.dropout) && self.tilt_deg.is_finite() && has_rays && is_field
    }
}

/// A LiDAR and a camera. The frame of the rig is that of its first LiDAR, of which there may be several.
#[derive(Clone, Debug)]
pub struct Rig {
    /// The LiDAR that is rendered.
    pub lidar: Lidar,
    /// Number of the LiDAR; the first, 0, lies at the origin of the rig. Each has noise of its own.
    pub lidar_number: u32,
    /// `p_rig = t_rig_lidar * p_lidar`; the identity for the first LiDAR.
    pub t_rig_lidar: Isometry3<f64>,
    /// Lens and image size of the camera.
    pub camera: Camera,
    /// `p_camera = t_camera_rig * p_rig`.
    pub t_camera_rig: Isometry3<f64>,
    /// Exposure of the lines of an image, which matters only while the rig moves.
    pub shutter: Shutter,
}

impl Rig {
    pub(crate) fn check(&self) -> Result<(), Invalid> {
        if !self.lidar.is_valid() {
            return Err(Invalid(format!("rig: {:?} is impossible", self.lidar)));
        }
        self.shutter.check()?;
        for (sensor, center) in [
            ("the camera is", self.t_camera_rig.inverse().translation.vector),
            ("a further LiDAR is", self.t_rig_lidar.translation.vector),
        ] {
            let lever = center.norm();
            if lever > crate::MAX_LEVER_M {
                return Err(Invalid(format!(
                    "rig: {sensor} {lever:.2} m from the LiDAR; the street keeps {} m free",
                    crate::MAX_LEVER_M
                )));
            }
        }
        Ok(())
    }
}

/// Largest distance between the positions that represent a path.
const SPOT_GAP_M: f64 = 0.5;
/// Upper bound of a rig's speed, metres or radians per second.
const MAX_RATE: f64 = 100.0;

/// Motion of a rig through the scene of a frame. Times are seconds from the middle of the sweep.
#[derive(Clone, Debug)]
pub struct RigMotion {
    /// Twist, metres and radians per second in the frame of the first LiDAR; `None` for a static rig.
    twist_per_s: Option<Vector6<f64>>,
    /// First and last time at which something is measured.
    pub(crate) ends_s: [f64; 2],
}

impl RigMotion {
    pub const STILL: Self = Self { twist_per_s: None, ends_s: [0.0; 2] };

    /// Creates the motion of a rig with a constant twist.
    pub fn new(twist_per_s: Vector6<f64>, rig: &Rig) -> Result<Self, Invalid> {
        if !twist_per_s.iter().all(|rate| rate.abs() <= MAX_RATE) {
            let found: [f64; 6] = twist_per_s.into();
            return Err(Invalid(format!("found a twist of {found:?} a second, needed at most {MAX_RATE}")));
        }
        let (half_sweep, shutter) = (0.5 * rig.lidar.sweep_s, &rig.shutter);
        let ends_s =
            [shutter.delay_s.min(-half_sweep), (shutter.delay_s + shutter.readout_s).max(half_sweep)];
        Ok(Self { twist_per_s: Some(twist_per_s), ends_s })
    }

    pub fn is_moving(&self) -> bool {
        self.twist_per_s.is_some()
    }

    /// The first LiDAR's pose in the world at a time, given its pose at time zero.
    pub fn pose_at(&self, t_world_lidar: &Isometry3<f64>, time_s: f64) -> Isometry3<f64> {
        // At rest the pose stays bit-identical.
        self.twist_per_s.map_or(*t_world_lidar, |twist| t_world_lidar * exp(&(twist * time_s)))
    }

    /// Moves a point from the frame of the rig at one time to that of another.
    pub fn seen_at(&self, point: Point3<f64>, from_s: f64, to_s: f64) -> Point3<f64> {
        self.twist_per_s.map_or(point, |twist| exp(&(twist * (from_s - to_s))) * point)
    }

    /// Positions of the LiDAR along the path, seen from above; the one at time zero is `spot`.
    pub fn positions(&self, spot: Vec2, t_world_lidar: &Isometry3<f64>) -> Vec<Vec2> {
        let Some(twist) = self.twist_per_s else { return vec![spot] };
        let [from, to] = self.ends_s;
        let steps = (twist.fixed_rows::<3>(0).norm() * (to - from) / SPOT_GAP_M).ceil().max(1.0) as usize;
        (0..=steps)
            .map(|step| from + (to - from) * step as f64 / steps as f64)
            .map(|time_s| self.pose_at(t_world_lidar, time_s).translation.vector.cast::<f32>())
            .map(|center| Vec2::new(center.x, center.y))
            .collect()
    }
}
