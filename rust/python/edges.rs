//! Steps along the scans of sweeps, and steps in range and colour at the borders between labels.

use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyReadonlyArray3,
};
use pyo3::prelude::*;
use rayon::prelude::*;

use super::arrays::{borrowed_rows, to_array2};
use super::calls::{detached, value_error};
use super::observations::{PyLabelledCloud, PyLabelledImage};
use crate::edges::{self, Steps};
use crate::label_borders::{Tiling, steps_at_pixel_borders, steps_at_point_borders};

#[pyclass(name = "Steps", frozen, get_all)]
pub(super) struct PySteps {
    range_m: Py<PyArray1<f32>>,
    to_range_step_m: Py<PyArray2<f32>>,
    to_intensity_step_m: Py<PyArray2<f32>>,
    spacing: f64,
    intensity: Option<Py<PyArray1<f32>>>,
}

#[pyfunction]
pub(super) fn edge_steps(
    py: Python<'_>,
    points: Vec<PyReadonlyArray2<f32>>,
    intensities: Vec<Option<PyReadonlyArray1<f32>>>,
    same_surface_m: f64,
) -> PyResult<Vec<PySteps>> {
    let rows = points.iter().map(|sweep| borrowed_rows("points", sweep)).collect::<PyResult<Vec<_>>>()?;
    let values = intensities
        .iter()
        .map(|values| values.as_ref().map(|values| values.as_slice()).transpose())
        .collect::<Result<Vec<_>, _>>()?;
    let counts = rows.iter().map(|sweep| sweep.len());
    if values.len() != rows.len()
        || counts.zip(&values).any(|(count, values)| values.is_some_and(|v| v.len() != count))
    {
        return Err(value_error("every sweep needs an intensity for each point, or None"));
    }
    let sweeps: Vec<_> = rows.iter().map(AsRef::as_ref).zip(values).collect();
    let steps = detached(|| edges::steps(&sweeps, same_surface_m));
    steps.iter().map(|steps| PySteps::new(py, steps)).collect()
}

impl PySteps {
    fn new(py: Python<'_>, steps: &Steps) -> PyResult<Self> {
        Ok(Self {
            range_m: PyArray1::from_slice(py, &steps.range_m).unbind(),
            to_range_step_m: to_array2(py, &steps.to_range_step_m)?.unbind(),
            to_intensity_step_m: to_array2(py, &steps.to_intensity_step_m)?.unbind(),
            spacing: steps.spacing,
            intensity: steps.intensity.as_ref().map(|values| PyArray1::from_slice(py, values).unbind()),
        })
    }
}

#[pyfunction]
#[pyo3(signature = (clouds, *, reach, num_blocks))]
pub(super) fn steps_at_label_changes<'py>(
    py: Python<'py>,
    clouds: Vec<PyRef<'_, PyLabelledCloud>>,
    reach: usize,
    num_blocks: usize,
) -> PyResult<Vec<Bound<'py, PyArray2<f32>>>> {
    let clouds = clouds.iter().map(|cloud| cloud.arrays()).collect::<PyResult<Vec<_>>>()?;
    let sums: Vec<Vec<f32>> = detached(|| {
        let all = clouds.par_iter();
        all.map(|(points, classes)| steps_at_point_borders(points, classes, reach, num_blocks)).collect()
    });
    sums.into_iter().map(|sums| sums.into_pyarray(py).reshape([num_blocks, 2 * reach + 1])).collect()
}

#[pyfunction]
#[pyo3(signature = (image, labels, *, reach, tiles))]
pub(super) fn steps_at_label_borders<'py>(
    py: Python<'py>,
    image: PyReadonlyArray3<u8>,
    labels: &PyLabelledImage,
    reach: usize,
    tiles: (usize, usize),
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let classes = labels.classes();
    let shape = image.as_array().dim();
    if shape != (classes.height, classes.width, 3) {
        let needed = (classes.height, classes.width, 3);
        return Err(value_error(format!("found an image of {shape:?}, needed {needed:?}")));
    }
    let array = image.as_array();
    let pixels = array.as_slice().map_or_else(|| array.iter().copied().collect(), <[u8]>::to_vec);
    let (pixels, _) = pixels.as_chunks::<3>();
    let sums = detached(|| steps_at_pixel_borders(pixels, classes, Tiling { reach, tiles }));
    let side = 2 * reach + 1;
    sums.into_pyarray(py).reshape([tiles.0 * tiles.1, side, side])
}
