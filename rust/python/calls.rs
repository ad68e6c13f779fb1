//! Calls of the core: their threads and the conversion of their errors.

use std::io;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use pyo3::exceptions::{PyMemoryError, PyOSError, PyValueError};
use pyo3::prelude::*;
use rayon::ThreadPool;

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

/// Raises an `InputError` from an `OSError` with the system's error number, as Python does where it fails to read a
/// file itself. A failed allocation has no number.
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

/// The thread pool of every parallel call; rayon's default until [`set_num_threads`] is called.
static POOL: Mutex<Option<Arc<ThreadPool>>> = Mutex::new(None);

/// Runs `f` without the GIL, on the chosen number of threads.
pub(super) fn detached<T: Send>(f: impl Send + FnOnce() -> T) -> T {
    let run = || {
        let pool = POOL.lock().unwrap_or_else(PoisonError::into_inner).clone();
        match pool {
            Some(pool) => pool.install(f),
            None => f(),
        }
    };
    Python::attach(|py| py.detach(run))
}

/// More threads than any machine has cores: creating a pool of a billion threads never ends.
const MAX_THREADS: usize = 4096;

#[pyfunction]
pub(super) fn set_num_threads(num_threads: usize) -> PyResult<()> {
    if num_threads > MAX_THREADS {
        return Err(value_error(format!("found {num_threads} threads, needed at most {MAX_THREADS}")));
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(num_threads)
        .build()
        .map_err(|e| value_error(e.to_string()))?;
    *POOL.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::new(pool));
    Ok(())
}
