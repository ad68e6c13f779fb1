//! Steps of range and colour at the borders between labels.

use numpy::{IntoPyArray, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray3};
use pyo3::prelude::*;
use rayon::prelude::*;

use super::errors::value_error;
use super::observations::{PyLabelledCloud, PyLabelledImage};
use super::threads::detached;
use crate::label_borders::{Tiling, steps_at_pixel_borders, steps_at_point_borders};

#[pyfunction]
#[pyo3(signature = (clouds, *, reach, num_blocks))]
pub(super) fn steps_at_label_changes<'py>(
    py: Python<'py>,
    clouds: Vec<PyRef<'_, PyLabelledCloud>>,
    reach: usize,
    num_blocks: usize,
) -> PyResult<Vec<Bound<'py, PyArray2<f32>>>> {
    let clouds = clouds.iter().map(|cloud| cloud.arrays()).collect::<PyResult<Vec<_>>>()?;
    let sums: Vec<Vec<f32>> = detached(py, || {
        let all = clouds.par_iter();
        all.map(|(points, classes)| steps_at_point_borders(points, classes, reach, num_blocks)).collect()
    });
    sums.into_iter().map(|sums| sums.into_pyarray(py).reshape([num_blocks, 2 * reach + 1])).collect()
}

#[pyfunction]
#[pyo3(signature = (picture, image, *, reach, tiles))]
pub(super) fn steps_at_label_borders<'py>(
    py: Python<'py>,
    picture: PyReadonlyArray3<u8>,
    image: &PyLabelledImage,
    reach: usize,
    tiles: (usize, usize),
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let classes = image.classes();
    let shape = picture.as_array().dim();
    if shape != (classes.height, classes.width, 3) {
        let needed = (classes.height, classes.width, 3);
        return Err(value_error(format!("found a picture of {shape:?}, needed {needed:?}")));
    }
    let array = picture.as_array();
    let pixels = array.as_slice().map_or_else(|| array.iter().copied().collect(), <[u8]>::to_vec);
    let (pixels, _) = pixels.as_chunks::<3>();
    let sums = detached(py, || steps_at_pixel_borders(pixels, classes, Tiling { reach, tiles }));
    let side = 2 * reach + 1;
    sums.into_pyarray(py).reshape([tiles.0 * tiles.1, side, side])
}
