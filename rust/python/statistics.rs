//! Quantiles of Student's t and of Fisher's F.

use pyo3::prelude::*;
use statrs::distribution::{ContinuousCDF, StudentsT};

use super::errors::value_error;
use crate::fisher;

#[pyfunction]
pub(super) fn student_quantile(probability: f64, degrees_of_freedom: f64) -> PyResult<f64> {
    let student = StudentsT::new(0.0, 1.0, degrees_of_freedom).map_err(|e| value_error(e.to_string()))?;
    if !(0.0..=1.0).contains(&probability) {
        return Err(value_error(format!("a probability is from 0 to 1, found {probability}")));
    }
    Ok(student.inverse_cdf(probability))
}

#[pyfunction]
pub(super) fn fisher_limit(alpha: f64, numerator: f64, denominator: f64) -> PyResult<f64> {
    fisher::fisher_limit(alpha, numerator, denominator).ok_or_else(|| {
        let found = format!("{alpha}, {numerator} and {denominator}");
        let most = fisher::MAX_TAIL;
        value_error(format!(
            "found {found}, needed a probability up to {most} and degrees of freedom from 1 on"
        ))
    })
}
