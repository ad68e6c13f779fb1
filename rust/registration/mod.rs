//! 2-D registration of label images with spherical label images by mutual information (Alg. 2, line 4).
//!
//! The histogram is pooled over all frames before MI is computed, since a single frame easily agrees by chance. The
//! exhaustive search covers all azimuths, the elevations at which image and sweep overlap, and in-plane rotations,
//! on coarse cells. Powell's method on finer cells then refines the best well-separated placements.

mod exhaustive;
mod local;
mod placements;

use nalgebra::Rotation3;

use crate::mutual_information::JointHistogram;
use crate::zoom::{Placement, Zoom};

pub use placements::register;

/// Settings: the fields of `InitializationConfig` in Python, which documents them; angles in radians.
#[derive(Clone, Copy, Debug)]
pub struct RegistrationConfig {
    pub zoom: Zoom,
    pub coarse_cell: f64,
    pub fine_cell: f64,
    pub max_roll: f64,
    pub roll_step: f64,
    pub min_cells_of_most: f64,
    pub num_hypotheses: usize,
    pub separation: f64,
}

/// A rotation of `T_camera_lidar`, and the angle (radians) around it that is searched.
pub type RotationBall = (Rotation3<f64>, f64);

/// A placement of the image on the sphere, with the agreement of the labels there.
#[derive(Clone, Debug)]
pub struct Hypothesis {
    pub placement: Placement,
    /// Mutual information of the pooled histogram, nats, less its bias.
    pub mutual_information: f64,
    /// Number of labelled returns on a labelled pixel, over all frames, among those used.
    pub num_pairs: f64,
    /// The pooled histogram.
    pub joint: JointHistogram,
}
