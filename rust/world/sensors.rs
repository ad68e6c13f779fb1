//! The rig: a LiDAR's firing pattern and flaws, and a camera beside it.

use std::f64::consts::TAU;

use nalgebra::{Isometry3, Vector3};

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::shutter::Shutter;

/// Turns of a rosette about z, and swings between its lowest and highest angle, per [`ROSETTE_PERIOD`] points. Neither
/// ratio is rational, so that the pattern never repeats.
const ROSETTE_TURNS: f64 = 20.0 * 1.618_033_988_749_895;
const ROSETTE_SWINGS: f64 = 700.0 * std::f64::consts::SQRT_2;
const ROSETTE_PERIOD: f64 = 20_000.0;

/// Where a LiDAR's rays point, in its own frame (x forward, y left, z up), in firing order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ScanPattern {
    /// Channels evenly spaced in elevation, turned through evenly spaced azimuths; column by column, from the top.
    Spinning {
        /// Rays of a column.
        channels: usize,
        /// Columns of a turn; the first looks along x, the next to its left.
        columns: usize,
        /// The highest channel's elevation.
        fov_up_deg: f64,
        /// The lowest channel's elevation, negative below the horizon.
        fov_down_deg: f64,
    },
    /// A flower all around the z axis, as a Livox Mid-360 draws: the ray swings in elevation while it turns, never
    /// along the same line again, so that every frame has other rays. It is no grid.
    Rosette {
        /// Rays of a frame.
        points: usize,
        /// The highest elevation.
        fov_up_deg: f64,
        /// The lowest elevation, negative below the horizon.
        fov_down_deg: f64,
    },
}

impl Default for ScanPattern {
    fn default() -> Self {
        Self::Spinning { channels: 64, columns: 800, fov_up_deg: 10.0, fov_down_deg: -30.0 }
    }
}

impl ScanPattern {
    /// The unit vectors of one frame's rays.
    pub fn directions(&self, frame: u64) -> Vec<Vector3<f64>> {
        match *self {
            Self::Spinning { channels, columns, fov_up_deg, fov_down_deg } => {
                let step = (fov_up_deg - fov_down_deg) / (channels.max(2) - 1) as f64;
                let elevation = |channel: usize| (fov_up_deg - step * channel as f64).to_radians();
                let azimuth = |column: usize| TAU * column as f64 / columns as f64;
                (0..columns)
                    .flat_map(|column| {
                        (0..channels).map(move |channel| toward(azimuth(column), elevation(channel)))
                    })
                    .collect()
            }
            Self::Rosette { points, fov_up_deg, fov_down_deg } => {
                let middle = 0.5 * (fov_up_deg + fov_down_deg);
                let swing = 0.5 * (fov_up_deg - fov_down_deg);
                let first = frame as f64 * points as f64;
                (0..points)
                    .map(|i| (first + i as f64) / ROSETTE_PERIOD)
                    .map(|t| {
                        let elevation = middle + swing * (TAU * (t * ROSETTE_SWINGS).fract()).sin();
                        toward(TAU * (t * ROSETTE_TURNS).fract(), elevation.to_radians())
                    })
                    .collect()
            }
        }
    }

    /// The part of the sweep that is over when a ray is fired; the rays of a column are fired together.
    pub(super) fn share_before(&self, ray: usize) -> f64 {
        match *self {
            Self::Spinning { channels, columns, .. } => (ray / channels) as f64 / columns as f64,
            Self::Rosette { points, .. } => ray as f64 / points as f64,
        }
    }

    fn is_valid(&self) -> bool {
        let (rays, up, down) = match *self {
            Self::Spinning { channels, columns, fov_up_deg, fov_down_deg } => {
                (channels * columns, fov_up_deg, fov_down_deg)
            }
            Self::Rosette { points, fov_up_deg, fov_down_deg } => (points, fov_up_deg, fov_down_deg),
        };
        rays > 0 && (-90.0..=90.0).contains(&down) && (down..=90.0).contains(&up)
    }
}

fn toward(azimuth: f64, elevation: f64) -> Vector3<f64> {
    let (level, up) = (elevation.cos(), elevation.sin());
    Vector3::new(level * azimuth.cos(), level * azimuth.sin(), up)
}

/// A LiDAR: its pattern and its flaws.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lidar {
    /// Where its rays point.
    pub pattern: ScanPattern,
    /// Standard deviation of the range, along the ray.
    pub range_noise_m: f64,
    /// The share of returns that are lost.
    pub dropout: f64,
    /// Nothing farther returns.
    pub max_range_m: f64,
    /// Seconds from the first ray of a sweep to that of the next.
    pub sweep_s: f64,
    /// How far the sensor's x axis is pitched below the vehicle's. The camera, mounted to the LiDAR, tilts with it.
    pub tilt_deg: f64,
}

impl Default for Lidar {
    fn default() -> Self {
        Self {
            pattern: ScanPattern::default(),
            range_noise_m: 0.02,
            dropout: 0.05,
            max_range_m: 120.0,
            sweep_s: 0.1,
            tilt_deg: 0.0,
        }
    }
}

impl Lidar {
    fn is_valid(&self) -> bool {
        let amounts = [self.range_noise_m, self.max_range_m, self.sweep_s];
        let sound = amounts.iter().all(|&x| x.is_finite() && x >= 0.0);
        sound && (0.0..=1.0).contains(&self.dropout) && self.tilt_deg.is_finite() && self.pattern.is_valid()
    }
}

/// A LiDAR and a camera, fixed to each other.
#[derive(Clone, Debug)]
pub struct Rig {
    /// The LiDAR.
    pub lidar: Lidar,
    /// The camera.
    pub camera: Camera,
    /// `p_camera = t_camera_lidar * p_lidar`.
    pub t_camera_lidar: Isometry3<f64>,
    /// When the lines of a picture are exposed; it matters only while the rig moves.
    pub shutter: Shutter,
}

impl Rig {
    /// Refuses a rig whose sensors cannot be.
    pub(super) fn check(&self) -> Result<()> {
        let lever = self.t_camera_lidar.inverse().translation.vector.norm();
        if !self.lidar.is_valid() {
            return Err(Error::Input(format!("rig: {:?} cannot be", self.lidar)));
        }
        self.shutter.check()?;
        if lever > super::MAX_LEVER_M {
            return Err(Error::Input(format!(
                "rig: the camera is {lever:.2} m from the LiDAR; the street keeps {} m free",
                super::MAX_LEVER_M
            )));
        }
        Ok(())
    }
}
