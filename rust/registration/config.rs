//! The settings of the registration.

use nalgebra::Rotation3;

use crate::zoom::Zoom;

/// Settings of the registration; angles in radians.
#[derive(Clone, Copy, Debug)]
pub struct RegistrationConfig {
    /// Mapping of the image to the angular grid.
    pub zoom: Zoom,
    /// Cell of the exhaustive search.
    pub coarse_cell: f64,
    /// Block of the label images in the refinement.
    pub fine_cell: f64,
    /// In-plane rotations from minus this to plus this are searched.
    pub max_roll: f64,
    /// Step between the in-plane rotations.
    pub roll_step: f64,
    /// A placement counts only if it overlaps at least this share of the cells of the best overlapping one.
    pub min_cells_of_most: f64,
    /// Hypotheses refined and returned.
    pub num_hypotheses: usize,
    /// Smallest rotation between two hypotheses.
    pub separation: f64,
}

/// A rotation of `T_camera_lidar`, and the angle (radians) from it within which others are searched.
pub type Around = (Rotation3<f64>, f64);
