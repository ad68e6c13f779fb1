//! The core's settings, read from the attributes of Python's config objects: the one place where they cross, and where each
//! is checked. What depends on other arguments is checked beside them.

use std::fmt::Debug;

use pyo3::conversion::FromPyObjectOwned;
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

/// What a setting has to be.
struct Needs<T> {
    holds: fn(&T) -> bool,
    words: &'static str,
}

const AT_LEAST_ONE: Needs<usize> = Needs { holds: |x| *x > 0, words: "at least 1" };
const ABOVE_ZERO: Needs<f64> = Needs { holds: is_positive, words: "a finite number above 0" };
const NOT_BELOW_ZERO: Needs<f64> =
    Needs { holds: |x| x.is_finite() && *x >= 0.0, words: "a finite number from 0 on" };
const FINITE: Needs<Vec<f64>> =
    Needs { holds: |all| all.iter().all(|x| x.is_finite()), words: "finite numbers" };
const ALL_ABOVE_ZERO: Needs<Vec<f64>> =
    Needs { holds: |all| all.iter().all(is_positive), words: "finite numbers above 0" };

fn is_positive(x: &f64) -> bool {
    x.is_finite() && *x > 0.0
}

/// An attribute of a Python object, of which something may be needed.
fn attribute<'py, T>(object: Borrowed<'_, 'py, PyAny>, name: &str, needs: Option<&Needs<T>>) -> PyResult<T>
where
    T: FromPyObjectOwned<'py> + Debug,
{
    let value: T = object.getattr(name)?.extract().map_err(Into::into)?;
    if let Some(Needs { words, .. }) = needs.filter(|needs| !(needs.holds)(&value)) {
        let config = object.get_type().name()?;
        return Err(value_error(format!("{config}.{name}: found {value:?}, needed {words}")));
    }
    Ok(value)
}

/// Fills structs from the attributes of a Python object that are named after their fields, and checks them. `step_rad:
/// step_deg` takes an angle from an attribute of another name, in degrees.
macro_rules! from_attributes {
    ($($config:ident { $($field:ident $(: $degrees:ident)? $([$needs:ident])?),+ $(,)? })+) => {
        $(impl<'py> FromPyObject<'_, 'py> for $config {
            type Error = PyErr;

            fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
                Ok(Self { $($field: from_attributes!(@read object, $field $(: $degrees)?, [$($needs)?])),+ })
            }
        })+

        /// The attributes that each of the core's settings is read from.
        static ATTRIBUTES: &[(&str, &[&str])] =
            &[$((stringify!($config), &[$(from_attributes!(@name $field $($degrees)?)),+])),+];
    };
    (@read $object:ident, $field:ident, []) => { attribute($object, stringify!($field), None)? };
    (@read $object:ident, $field:ident, [$needs:ident]) => {
        attribute($object, stringify!($field), Some(&$needs))?
    };
    (@read $object:ident, $field:ident : $degrees:ident, [$needs:ident]) => {
        f64::to_radians(attribute($object, stringify!($degrees), Some(&$needs))?)
    };
    (@name $field:ident) => { stringify!($field) };
    (@name $field:ident $degrees:ident) => { stringify!($degrees) };
}

from_attributes! {
    Neighbors { count, search, sigma_px, max_difference_m }
    AlignmentConfig {
        edge_band_px,
        steps,
        batch_size [AT_LEAST_ONE],
        step_size,
        final_step,
        max_baseline_m,
        max_points [AT_LEAST_ONE],
    }
    PolishConfig { edge_band_px, max_rounds, max_steps, tolerance_px, max_baseline_m }
    SensitivityConfig { factor, edge_band_px, max_points [AT_LEAST_ONE], regions_across }
    JointConfig {
        factors,
        edge_band_px,
        max_coarse_points [AT_LEAST_ONE],
        max_rounds,
        max_steps,
        tolerance,
        max_baseline_m,
        changes [FINITE],
        sigmas [ALL_ABOVE_ZERO],
        evidence [ABOVE_ZERO],
    }
    RegistrationConfig {
        zoom,
        coarse_cell: coarse_cell_deg [ABOVE_ZERO],
        fine_cell: fine_cell_deg [ABOVE_ZERO],
        max_roll: max_roll_deg [NOT_BELOW_ZERO],
        roll_step: roll_step_deg [ABOVE_ZERO],
        min_cells_of_most,
        num_hypotheses,
        separation: separation_deg [NOT_BELOW_ZERO],
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
        step_rad: step_deg [ABOVE_ZERO],
        step_m,
        tolerance,
        max_rounds,
        max_restarts,
        max_points [AT_LEAST_ONE],
    }
    LidarSettings {
        pattern,
        channels,
        columns,
        fov_up_deg,
        fov_down_deg,
        range_noise_m,
        dropout,
        max_range_m,
        sweep_s,
        lidar_tilt_deg,
    }
    ShutterSettings { delay_ms, readout_ms, readout_direction }
}

/// The attributes that each of the core's settings is read from, by the name of the setting.
#[pyfunction]
pub(super) fn config_attributes() -> Vec<(&'static str, Vec<&'static str>)> {
    ATTRIBUTES.iter().map(|(config, names)| (*config, names.to_vec())).collect()
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

/// A LiDAR as a synthetic drive describes it.
struct LidarSettings {
    pattern: String,
    channels: usize,
    columns: usize,
    fov_up_deg: f64,
    fov_down_deg: f64,
    range_noise_m: f64,
    dropout: f64,
    max_range_m: f64,
    sweep_s: f64,
    lidar_tilt_deg: f64,
}

impl<'py> FromPyObject<'_, 'py> for Lidar {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let LidarSettings { pattern, channels, columns, fov_up_deg, fov_down_deg, .. } = object.extract()?;
        let LidarSettings { range_noise_m, dropout, max_range_m, sweep_s, lidar_tilt_deg, .. } =
            object.extract()?;
        let pattern = match pattern.as_str() {
            "spinning" => ScanPattern::Spinning { channels, columns, fov_up_deg, fov_down_deg },
            "rosette" => ScanPattern::Rosette { points: channels * columns, fov_up_deg, fov_down_deg },
            other => return Err(value_error(format!("pattern '{other}' is not known"))),
        };
        Ok(Self { pattern, range_noise_m, dropout, max_range_m, sweep_s, tilt_deg: lidar_tilt_deg })
    }
}

/// A shutter as a synthetic drive describes it.
struct ShutterSettings {
    delay_ms: f64,
    readout_ms: f64,
    readout_direction: String,
}

impl<'py> FromPyObject<'_, 'py> for Shutter {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let ShutterSettings { delay_ms, readout_ms, readout_direction } = object.extract()?;
        let direction = direction(&readout_direction)?;
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
