//! Rows, images and matrices from NumPy and to it.

use std::borrow::Cow;

use nalgebra::DMatrix;
use numpy::{IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;

use super::errors::value_error;
use crate::label_image::LabelImage;

/// A matrix to NumPy.
pub(super) type Array2<'py> = Bound<'py, PyArray2<f64>>;

/// A matrix from NumPy.
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

/// Rows from NumPy, copied.
pub(super) fn rows<const N: usize, T: Copy + numpy::Element>(
    name: &str,
    array: &PyReadonlyArray2<T>,
) -> PyResult<Vec<[T; N]>> {
    borrowed_rows(name, array).map(Cow::into_owned)
}

/// Rows from NumPy, copied only if they do not follow one another in memory.
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

/// A label image to NumPy.
pub(super) fn image_array(py: Python<'_>, image: LabelImage<u8>) -> PyResult<Bound<'_, PyArray2<u8>>> {
    image.ids.into_pyarray(py).reshape([image.height, image.width])
}
