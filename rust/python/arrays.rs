//! Conversion of rows, images, matrices and rigid transforms from and to NumPy.

use std::borrow::Cow;

use nalgebra::{DMatrix, Isometry3, Matrix3x4, Rotation3, Translation3, UnitQuaternion};
use numpy::{IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;

use super::calls::value_error;
use crate::label_image::LabelImage;

pub(super) type Array2<'py> = Bound<'py, PyArray2<f64>>;

pub(super) fn matrix_6x6(matrix: &PyReadonlyArray2<f64>) -> PyResult<DMatrix<f64>> {
    let matrix = matrix.as_array();
    if matrix.shape() != [6, 6] {
        return Err(value_error(format!(
            "found an inverse curvature of {:?}, needed [6, 6]",
            matrix.shape()
        )));
    }
    Ok(DMatrix::from_fn(6, 6, |row, column| matrix[[row, column]]))
}

pub(super) fn rows<const N: usize, T: Copy + numpy::Element>(
    name: &str,
    array: &PyReadonlyArray2<T>,
) -> PyResult<Vec<[T; N]>> {
    borrowed_rows(name, array).map(Cow::into_owned)
}

/// Borrows rows from NumPy, and copies them only if they are not contiguous.
pub(super) fn borrowed_rows<'a, const N: usize, T: Copy + numpy::Element>(
    name: &str,
    array: &'a PyReadonlyArray2<T>,
) -> PyResult<Cow<'a, [[T; N]]>> {
    let array = array.as_array();
    if array.ncols() != N {
        return Err(value_error(format!("{name} needs shape (N, {N}), found {:?}", array.dim())));
    }
    Ok(match array.to_slice() {
        Some(values) => Cow::Borrowed(values.as_chunks().0),
        None => array.rows().into_iter().map(|row| std::array::from_fn(|i| row[i])).collect(),
    })
}

/// The points of sweeps, as [`borrowed_rows`] gives them.
pub(super) fn borrowed_sweeps<'a>(sweeps: &'a [PyReadonlyArray2<f32>]) -> PyResult<Vec<Cow<'a, [[f32; 3]]>>> {
    sweeps.iter().map(|sweep| borrowed_rows("points", sweep)).collect()
}

pub(super) fn to_array2<'py, const N: usize, T: Copy + numpy::Element>(
    py: Python<'py>,
    rows: &[[T; N]],
) -> PyResult<Bound<'py, PyArray2<T>>> {
    rows.as_flattened().to_vec().into_pyarray(py).reshape([rows.len(), N])
}

pub(super) fn dense_image(array: &PyReadonlyArray2<u8>) -> LabelImage<u8> {
    let array = array.as_array();
    let (height, width) = array.dim();
    let ids = array.as_slice().map_or_else(|| array.iter().copied().collect(), <[u8]>::to_vec);
    LabelImage { width, height, ids }
}

/// `T_camera_lidar`, taken to be rigid, (4, 4) in Python.
#[derive(Clone, Copy)]
pub(super) struct Pose(pub Isometry3<f64>);

impl<'a, 'py> FromPyObject<'a, 'py> for Pose {
    type Error = PyErr;

    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        let Affine(m) = object.extract()?;
        let rotation = Rotation3::from_matrix_unchecked(m.fixed_columns::<3>(0).into_owned());
        let translation = Translation3::from(m.column(3).into_owned());
        Ok(Self(Isometry3::from_parts(translation, UnitQuaternion::from_rotation_matrix(&rotation))))
    }
}

impl<'py> IntoPyObject<'py> for Pose {
    type Target = PyArray2<f64>;
    type Output = Bound<'py, Self::Target>;
    type Error = PyErr;

    fn into_pyobject(self, py: Python<'py>) -> PyResult<Self::Output> {
        let rows: [[f64; 4]; 4] = self.0.to_homogeneous().transpose().into();
        to_array2(py, &rows)
    }
}

/// The first three rows of a transform that need not be rigid.
pub(super) struct Affine(pub Matrix3x4<f64>);

impl<'a, 'py> FromPyObject<'a, 'py> for Affine {
    type Error = PyErr;

    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        let matrix: PyReadonlyArray2<f64> = object.extract()?;
        let m = matrix.as_array();
        if m.dim() != (4, 4) || m.iter().any(|x| !x.is_finite()) {
            return Err(value_error("T_camera_lidar needs to be a finite 4 x 4 matrix"));
        }
        Ok(Self(Matrix3x4::from_fn(|i, j| m[[i, j]])))
    }
}

#[pyfunction]
pub(super) fn quaternion(t: Pose) -> [f64; 4] {
    let rotation = t.0.rotation.into_inner().normalize();
    let canonical = if rotation.w < 0.0 { -rotation } else { rotation };
    canonical.coords.into()
}
