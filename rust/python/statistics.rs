//! Quantiles of Student's t and of Fisher's F.

use pyo3::prelude::*;

use super::calls::value_error;
use crate::distributions;

#[pyfunction]
pub(super) fn student_quantile(probability: f64, degrees_of_freedom: f64) -> PyResult<f64> {
    distributions::student_quantile(probability, degrees_of_freedom).ok_or_else(|| {
        let (rarest, fewest) = (distributions::MIN_TAIL, distributions::MIN_DEGREES);
        value_error(format!(
            "found {probability} and {degrees_of_freedom}, expected a probability from {rarest:e} to 1 - {rarest:e} and \
             finite degrees of freedom from {fewest} on"
        ))
    })
}

#[pyfunction]
pub(super) fn fisher_limit(alpha: f64, numerator: f64, denominator: f64) -> PyResult<f64> {
    distributions::fisher_limit(alpha, numerator, denominator).ok_or_else(|| {
        let found = format!("{alpha}, {numerator} and {denominator}");
        let most = distributions::MAX_TAIL;
        value_error(format!(
            "found {found}, expected a probability up to {most} and degrees of freedom from 1 on"
        ))
    })
}
