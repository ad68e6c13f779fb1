//! Rigid transforms from NumPy and to it.

use nalgebra::{Isometry3, Matrix3x4, Rotation3, Translation3, UnitQuaternion};
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;

use super::arrays::{Array2, to_array2};
use super::errors::value_error;

/// The first three rows of `T_camera_lidar`.
pub(super) fn affine(matrix: &PyReadonlyArray2<f64>) -> PyResult<Matrix3x4<f64>> {
    let m = matrix.as_array();
    if m.dim() != (4, 4) || m.iter().any(|x| !x.is_finite()) {
        return Err(value_error("T_camera_lidar needs to be a finite 4 x 4 matrix"));
    }
    Ok(Matrix3x4::from_fn(|i, j| m[[i, j]]))
}

/// `T_camera_lidar`, which is taken to be rigid.
pub(super) fn isometry(matrix: &PyReadonlyArray2<f64>) -> PyResult<Isometry3<f64>> {
    let m = affine(matrix)?;
    let rotation = Rotation3::from_matrix_unchecked(m.fixed_columns::<3>(0).into_owned());
    Ok(Isometry3::from_parts(
        Translation3::from(m.column(3).into_owned()),
        UnitQuaternion::from_rotation_matrix(&rotation),
    ))
}

pub(super) fn matrix<'py>(py: Python<'py>, pose: &Isometry3<f64>) -> PyResult<Array2<'py>> {
    let rows: [[f64; 4]; 4] = pose.to_homogeneous().transpose().into();
    to_array2(py, &rows)
}

#[pyfunction]
pub(super) fn quaternion(t: PyReadonlyArray2<f64>) -> PyResult<[f64; 4]> {
    let rotation = isometry(&t)?.rotation.into_inner().normalize();
    let canonical = if rotation.w < 0.0 { -rotation } else { rotation };
    Ok(canonical.coords.into())
}
