//! The points that count in the mutual information.

use nalgebra::{Point2, Vector3};

use crate::pyramid::Sampled;

/// The labelled points of the image that count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counted {
    /// All of them.
    All,
    /// The points that no nearer return hides from the camera.
    Visible,
}

/// A labelled point on a labelled pixel.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Metres, LiDAR frame.
    pub position: Vector3<f64>,
    pub class: u8,
    pub frame: u32,
    /// Index among the frame's points.
    pub point: u32,
    /// Labelled share of the blocks around it at the anchor pose.
    pub weight: f32,
}

/// A sample at a pose.
#[derive(Clone, Copy, Debug)]
pub(super) struct ProjectedSample {
    pub class: u8,
    pub frame: u32,
    pub point: u32,
    pub weight: f32,
    pub p_camera: Vector3<f64>,
    pub pixel: Point2<f64>,
}

/// What points weigh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Weights {
    /// A sample's weight at the anchor pose, wherever it projects.
    AtAnchor,
    /// The labelled share where a point lands, of its share of a class: its weight.
    WhereItLands,
}

impl Weights {
    #[inline]
    pub fn of(self, sample: &Sample, sampled: &Sampled) -> f32 {
        match self {
            Self::AtAnchor => sample.weight,
            Self::WhereItLands => (f64::from(sample.weight) * sampled.total()) as f32,
        }
    }
}
