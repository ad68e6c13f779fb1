//! Settings of the core, read from the attributes of Python's config objects and checked. Settings that depend on
//! other arguments are checked together with those.

use std::fmt::Debug;

use geometry::shutter::{Direction, Shutter};
use pyo3::conversion::FromPyObjectOwned;
use pyo3::prelude::*;
use streets::{Lidar, Pattern};

use super::calls::value_error;
use crate::alignment::{AlignmentConfig, AscentConfig, SensitivityConfig};
use crate::labelling::Neighbors;
use crate::registration::RegistrationConfig;
use crate::segmentation::SegmentationConfig;
use crate::semantic_distance::DescentConfig;
use crate::zoom::Zoom;

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

/// Reads an attribute of a Python object and checks what it needs.
fn attribute<'py, T>(object: Borrowed<'_, 'py, PyAny>, name: &str, needs: Option<&Needs<T>>) -> PyResult<T>
where
    T: FromPyObjectOwned<'py> + Debug,
{
    let value: T = object.getattr(name)?.extract().map_err(Into::into)?;
    if let Some(Needs { words, .. }) = needs.filter(|needs| !(needs.holds)(&value)) {
        let config = object.get_type().name()?;
        return Err(value_error(format!("{config}.{name}: found {value:?}, expected {words}")));
    }
    Ok(value)
}

/// A setting whose type is another crate's: only a type of this crate may be made from Python's objects.
#[derive(Debug)]
pub(super) struct Foreign<T>(pub T);

fn own<T>(Foreign(value): Foreign<T>) -> T {
    value
}

/// Fills structs from the attributes of a Python object that are named like their fields, and checks them. Those of
/// another crate are filled `in Foreign`.
/// `step_rad: step_deg => radians` reads a field from an attribute of another name and converts it.
macro_rules! from_attributes {
    ($($config:ident $(in $wrapper:ident)? { $($field:ident $(: $other:ident $(=> $convert:ident)?)? $([$needs:ident])?),+ $(,)? })+) => {
        $(impl<'py> FromPyObject<'_, 'py> for wrapped_type!($config $(, $wrapper)?) {
            type Error = PyErr;

            fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
                let config = $config {
                    $($field: {
                        let value = attribute(object, name!($field $($other)?), needs!($($needs)?))?;
                        $($(let value = $convert(value);)?)?
                        value
                    }),+
                };
                Ok(wrapped!(config $(, $wrapper)?))
            }
        })+

        /// The attributes from which each setting of the core is read.
        static ATTRIBUTES: &[(&str, &[&str])] =
            &[$((stringify!($config), &[$(name!($field $($other)?)),+])),+];
    };
}

macro_rules! wrapped_type {
    ($inner:ident) => {
        $inner
    };
    ($inner:ident, $wrapper:ident) => {
        $wrapper<$inner>
    };
}

macro_rules! wrapped {
    ($inner:expr) => {
        $inner
    };
    ($inner:expr, $wrapper:ident) => {
        $wrapper($inner)
    };
}

macro_rules! name {
    ($field:ident) => {
        stringify!($field)
    };
    ($field:ident $other:ident) => {
        stringify!($other)
    };
}

macro_rules! needs {
    () => {
        None
    };
    ($needs:ident) => {
        Some(&$needs)
    };
}

fn radians(degrees: f64) -> f64 {
    degrees.to_radians()
}

fn seconds(milliseconds: f64) -> f64 {
    1e-3 * milliseconds
}

from_attributes! {
    Neighbors { count, search, sigma_px, max_difference_m }
    AlignmentConfig {
        steps,
        batch_size [AT_LEAST_ONE],
        step_size,
        final_step,
        max_points [AT_LEAST_ONE],
    }
    PolishConfig { max_rounds, max_steps, tolerance_px }
    SensitivityConfig { factor, max_points [AT_LEAST_ONE], regions_across }
    AscentConfig {
        factors,
        max_coarse_points [AT_LEAST_ONE],
        max_rounds,
        max_steps,
        tolerance,
        changes [FINITE],
        sigmas [ALL_ABOVE_ZERO],
        evidence [ABOVE_ZERO],
    }
    RegistrationConfig {
        zoom,
        coarse_cell: coarse_cell_deg => radians [ABOVE_ZERO],
        fine_cell: fine_cell_deg => radians [ABOVE_ZERO],
        max_roll: max_roll_deg => radians [NOT_BELOW_ZERO],
        roll_step: roll_step_deg => radians [ABOVE_ZERO],
        min_cells_of_most,
        num_hypotheses,
        separation: separation_deg => radians [NOT_BELOW_ZERO],
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
        step_rad: step_deg => radians [ABOVE_ZERO],
        step_m,
        tolerance,
        max_rounds,
        max_restarts,
        max_points [AT_LEAST_ONE],
    }
    Lidar in Foreign {
        pattern: pattern => own,
        channels,
        columns,
        fov_up_deg,
        fov_down_deg,
        range_noise_m,
        dropout,
        max_range_m,
        sweep_s,
        tilt_deg: lidar_tilt_deg,
    }
    Shutter in Foreign { delay_s: delay_ms => seconds, readout_s: readout_ms => seconds, direction: readout_direction => own }
}

#[pyfunction]
pub(super) fn config_attributes() -> Vec<(&'static str, Vec<&'static str>)> {
    ATTRIBUTES.iter().map(|(config, names)| (*config, names.to_vec())).collect()
}

/// Settings of a polish: the same ascent over the pose alone, at full resolution.
pub(super) struct PolishConfig {
    max_rounds: usize,
    max_steps: usize,
    tolerance_px: f64,
}

impl From<PolishConfig> for AscentConfig {
    fn from(config: PolishConfig) -> Self {
        let PolishConfig { max_rounds, max_steps, tolerance_px: tolerance } = config;
        Self {
            factors: vec![1],
            max_coarse_points: usize::MAX,
            max_rounds,
            max_steps,
            tolerance,
            changes: Vec::new(),
            sigmas: Vec::new(),
            evidence: 1.0,
        }
    }
}

/// Parses variants from their names.
macro_rules! from_names {
    ($($kind:ident $(in $wrapper:ident)? { $($name:literal => $variant:ident),+ })+) => {
        $(impl<'py> FromPyObject<'_, 'py> for wrapped_type!($kind $(, $wrapper)?) {
            type Error = PyErr;

            fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
                let kind = match object.extract::<String>()?.as_str() {
                    $($name => $kind::$variant,)+
                    other => {
                        let (kind, needed) = (stringify!($kind).to_lowercase(), [$($name),+].join(" or "));
                        return Err(value_error(format!("{kind} '{other}' is not known, needs {needed}")));
                    }
                };
                Ok(wrapped!(kind $(, $wrapper)?))
            }
        })+
    };
}

from_names! {
    Zoom { "exact" => Exact, "paper" => Paper }
    Pattern in Foreign { "spinning" => Spinning, "rosette" => Rosette }
    Direction in Foreign { "down" => Down, "up" => Up, "right" => Right, "left" => Left }
}
