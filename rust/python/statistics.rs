//! Student's t.

use pyo3::prelude::*;
use statrs::distribution::{ContinuousCDF, StudentsT};

use super::errors::value_error;

#[pyfunction]
pub(super) fn student_quantile(probability: f64, degrees_of_freedom: f64) -> PyResult<f64> {
    let student = StudentsT::new(0.0, 1.0, degrees_of_freedom).map_err(|e| value_error(e.to_string()))?;
    if !(0.0..=1.0).contains(&probability) {
        return Err(value_error(format!("a probability is from 0 to 1, found {probability}")));
    }
    Ok(student.inverse_cdf(probability))
}
