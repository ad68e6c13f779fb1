//! Errors of the core as Python's exceptions.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::error::Error;

pyo3::import_exception!(semcal_cli.errors, InputError);
pyo3::import_exception!(semcal_cli.errors, CalibrationError);

impl From<Error> for PyErr {
    fn from(error: Error) -> Self {
        let message = error.to_string();
        match error {
            Error::File { .. } | Error::Input(_) => InputError::new_err(message),
            Error::Calibration(_) => CalibrationError::new_err(message),
        }
    }
}

pub(super) fn value_error(message: impl Into<String>) -> PyErr {
    PyValueError::new_err(message.into())
}
