//! Calls of the core: their threads and the conversion of their errors.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::{io, mem, process};

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

/// The threads of every parallel call.
struct Pool {
    /// The process that they belong to: a fork copies this value, but none of its threads.
    process: u32,
    /// 0 is rayon's default, one for each core.
    num_threads: usize,
    threads: Arc<ThreadPool>,
}

/// Set by the first parallel call or by [`set_num_threads`]. It is locked only with the GIL held, so that no thread of
/// Python forks while another one has locked it.
static POOL: Mutex<Option<Pool>> = Mutex::new(None);

impl Pool {
    fn new(num_threads: usize) -> PyResult<Self> {
        let threads = rayon::ThreadPoolBuilder::new()
            .num_threads(num_threads)
            .build()
            .map_err(|e| value_error(e.to_string()))?;
        Ok(Self { process: process::id(), num_threads, threads: Arc::new(threads) })
    }
}

/// Replaces the pool. One from before a fork is forgotten, because dropping it would wake threads that are
/// gone, and lock what they may hold.
fn replace(pool: &mut Option<Pool>, new: Pool) {
    if let Some(old) = pool.replace(new).filter(|old| old.process != process::id()) {
        mem::forget(old);
    }
}

/// Finds the threads of this process, which are made for its first call.
fn threads(_: Python<'_>) -> PyResult<Arc<ThreadPool>> {
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    let num_threads = match &*pool {
        Some(pool) if pool.process == process::id() => return Ok(Arc::clone(&pool.threads)),
        Some(before_fork) => before_fork.num_threads,
        None => 0,
    };
    let new = Pool::new(num_threads)?;
    let threads = Arc::clone(&new.threads);
    replace(&mut pool, new);
    Ok(threads)
}

/// Runs `f` without the GIL, on the chosen number of threads; on rayon's own if those cannot be made.
pub(super) fn detached<T: Send>(f: impl Send + FnOnce() -> T) -> T {
    Python::attach(|py| match threads(py) {
        Ok(threads) => py.detach(|| threads.install(f)),
        Err(_) => py.detach(f),
    })
}

/// More threads than any machine has cores: creating a pool of a billion threads never ends.
const MAX_THREADS: usize = 4096;

#[pyfunction]
pub(super) fn set_num_threads(num_threads: usize) -> PyResult<()> {
    if num_threads > MAX_THREADS {
        return Err(value_error(format!("found {num_threads} threads, needed at most {MAX_THREADS}")));
    }
    let new = Pool::new(num_threads)?;
    replace(&mut POOL.lock().unwrap_or_else(PoisonError::into_inner), new);
    Ok(())
}
