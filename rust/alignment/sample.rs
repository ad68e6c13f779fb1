//! Samples: labelled points on labelled pixels, and how they count.

use nalgebra::{Point2, Vector3};

use crate::pyramid::{Corners, Sampled};

/// Which labelled points inside the image count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counted {
    /// All of them.
    All,
    /// The points that no nearer return among those used occludes.
    Visible,
}

/// A labelled point on a labelled pixel.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Metres, LiDAR frame.
    pub position: Vector3<f64>,
    pub class: u8,
    pub frame: u32,
    /// Index of the point in its frame.
    pub point: u32,
    /// Labelled share of the blocks around the point at the anchor pose.
    pub weight: f32,
}

/// A sample at a pose, on blocks of several classes, whose shares change with the pose.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mixed {
    pub sample: Sample,
    pub p_camera: Vector3<f64>,
    pub pixel: Point2<f64>,
}

/// How points are weighted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Weights {
    /// By the weight at the anchor pose, wherever the point projects.
    AtAnchor,
    /// By the weight of the sample times the labelled share where it projects.
    WhereItLands,
}

impl Weights {
    pub fn of(self, sample: &Sample, sampled: &Sampled<impl Corners>) -> f32 {
        match self {
            Self::AtAnchor => sample.weight,
            Self::WhereItLands => (f64::from(sample.weight) * sampled.total()) as f32,
        }
    }
}
