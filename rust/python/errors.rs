//! Errors of the core as Python's exceptions.

use std::io;
use std::path::PathBuf;

use pyo3::exceptions::{PyMemoryError, PyOSError, PyValueError};
use pyo3::prelude::*;

use crate::error::Error;

pyo3::import_exception!(semcal_cli.errors, InputError);
pyo3::import_exception!(semcal_cli.errors, CalibrationError);

impl From<Error> for PyErr {
    fn from(error: Error) -> Self {
        let message = error.to_string();
        match error {
            Error::File { .. } | Error::Input(_) => InputError::new_err(message),
            Error::System { path, source } => of_system(message, path, &source),
            Error::Calibration(_) => CalibrationError::new_err(message),
        }
    }
}

/// An `InputError` that an `OSError` with the system's number stands behind, as where Python itself fails to read. A
/// failed allocation has no number.
fn of_system(message: String, path: PathBuf, source: &io::Error) -> PyErr {
    let (error, reason) = (InputError::new_err(message), source.to_string());
    let cause = source.raw_os_error().map_or_else(
        || PyMemoryError::new_err(reason.clone()),
        |number| PyOSError::new_err((number, reason.clone(), path.into_os_string())),
    );
    Python::attach(|py| error.set_cause(py, Some(cause)));
    error
}

pub(super) fn value_error(message: impl Into<String>) -> PyErr {
    PyValueError::new_err(message.into())
}
