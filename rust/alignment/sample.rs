//! The points that count.

use nalgebra::{Point2, Vector3};

/// Which labelled points of the picture count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counted {
    /// All.
    All,
    /// Those that no nearer return hides from the camera.
    Visible,
}

/// A labelled point on a labelled pixel.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Metres, LiDAR frame.
    pub position: Vector3<f64>,
    pub class: u8,
    pub frame: u32,
    /// Labelled share of the blocks around it at the anchor pose.
    pub weight: f32,
}

/// A sample at a pose.
#[derive(Clone, Copy, Debug)]
pub(super) struct ProjectedSample {
    pub class: u8,
    pub frame: u32,
    pub weight: f32,
    pub p_camera: Vector3<f64>,
    pub pixel: Point2<f64>,
}
