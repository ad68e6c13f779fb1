//! The core's settings, read from the attributes of Python's config objects.

use pyo3::prelude::*;

use super::errors::value_error;
use crate::alignment::{AlignmentConfig, JointConfig, PolishConfig, SensitivityConfig};
use crate::labelling::Neighbors;
use crate::registration::RegistrationConfig;
use crate::segmentation::SegmentationConfig;
use crate::semantic_distance::DescentConfig;
use crate::shutter::{Direction, Shutter};
use crate::world::{Lidar, ScanPattern};
use crate::zoom::Zoom;

/// An attribute of a Python object, or a conversion of a number with another name.
macro_rules! attribute {
    ($object:ident, $name:ident) => {
        $object.getattr(stringify!($name))?.extract()?
    };
    ($object:ident, $field:ident, $name:ident, $convert:ident) => {
        f64::$convert($object.getattr(stringify!($name))?.extract()?)
    };
}

/// Fills structs from the attributes of a Python object that are named after their fields. `step: step_deg.to_radians()`
/// takes an attribute of another name and converts it.
macro_rules! from_attributes {
    ($($config:ident { $($field:ident $(: $name:ident.$convert:ident())?),+ $(,)? })+) => {$(
        impl<'py> FromPyObject<'_, 'py> for $config {
            type Error = PyErr;

            fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
                Ok(Self { $($field: attribute!(object, $field $(, $name, $convert)?)),+ })
            }
        }
    )+};
}

from_attributes! {
    Neighbors { count, search, sigma_px, max_difference_m }
    AlignmentConfig { edge_band_px, steps, batch_size, step_size, final_step, max_baseline_m, max_points }
    PolishConfig { edge_band_px, max_rounds, max_steps, tolerance_px, max_baseline_m }
    SensitivityConfig { factor, edge_band_px, max_points, regions_across }
    JointConfig {
        factors,
        edge_band_px,
        max_coarse_points,
        max_rounds,
        max_steps,
        tolerance,
        max_baseline_m,
        changes,
        sigmas,
        evidence,
    }
    RegistrationConfig {
        zoom,
        coarse_cell: coarse_cell_deg.to_radians(),
        fine_cell: fine_cell_deg.to_radians(),
        max_roll: max_roll_deg.to_radians(),
        roll_step: roll_step_deg.to_radians(),
        min_cells_of_most,
        num_hypotheses,
        separation: separation_deg.to_radians(),
    }
    SegmentationConfig {
        ground_tolerance_m,
        ground_cell_m,
        object_gap_m,
        object_gap_rays,
        object_cell_m,
        min_points,
    }
    DescentConfig {
        step_rad: step_deg.to_radians(),
        step_m,
        tolerance,
        max_rounds,
        max_restarts,
        max_points,
    }
}

impl<'py> FromPyObject<'_, 'py> for Zoom {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let name: String = object.extract()?;
        match name.as_str() {
            "exact" => Ok(Self::Exact),
            "paper" => Ok(Self::Paper),
            other => {
                let message = format!("zoom '{other}' is not known, needs exact or paper");
                Err(value_error(message))
            }
        }
    }
}

impl<'py> FromPyObject<'_, 'py> for Lidar {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let name: String = attribute!(object, pattern);
        let (channels, columns): (usize, usize) = (attribute!(object, channels), attribute!(object, columns));
        let (fov_up_deg, fov_down_deg) = (attribute!(object, fov_up_deg), attribute!(object, fov_down_deg));
        let pattern = match name.as_str() {
            "spinning" => ScanPattern::Spinning { channels, columns, fov_up_deg, fov_down_deg },
            "rosette" => ScanPattern::Rosette { points: channels * columns, fov_up_deg, fov_down_deg },
            other => return Err(value_error(format!("pattern '{other}' is not known"))),
        };
        Ok(Self {
            pattern,
            range_noise_m: attribute!(object, range_noise_m),
            dropout: attribute!(object, dropout),
            max_range_m: attribute!(object, max_range_m),
            sweep_s: attribute!(object, sweep_s),
            tilt_deg: attribute!(object, lidar_tilt_deg),
        })
    }
}

impl<'py> FromPyObject<'_, 'py> for Shutter {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let name: String = attribute!(object, readout_direction);
        let direction = direction(&name)?;
        let (delay_ms, readout_ms): (f64, f64) =
            (attribute!(object, delay_ms), attribute!(object, readout_ms));
        Ok(Self { delay_s: 1e-3 * delay_ms, readout_s: 1e-3 * readout_ms, direction })
    }
}

/// The way in which a shutter rolls, by its name.
pub(super) fn direction(name: &str) -> PyResult<Direction> {
    match name {
        "down" => Ok(Direction::Down),
        "up" => Ok(Direction::Up),
        "right" => Ok(Direction::Right),
        "left" => Ok(Direction::Left),
        other => Err(value_error(format!("readout direction '{other}' is not known"))),
    }
}
