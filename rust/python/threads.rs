//! The threads that the core runs on.

use std::sync::{Arc, Mutex, PoisonError};

use pyo3::prelude::*;
use rayon::ThreadPool;

use super::errors::value_error;

/// The threads of every parallel call; rayon's own default until [`set_num_threads`] is called.
static POOL: Mutex<Option<Arc<ThreadPool>>> = Mutex::new(None);

/// Runs `f` without the GIL, on the chosen number of threads.
pub(super) fn detached<T: Send>(py: Python<'_>, f: impl Send + FnOnce() -> T) -> T {
    py.detach(|| {
        let pool = POOL.lock().unwrap_or_else(PoisonError::into_inner).clone();
        match pool {
            Some(pool) => pool.install(f),
            None => f(),
        }
    })
}

/// More threads than any machine has cores: a pool of a thousand million is never done.
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
