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
use crate::edges::{self, Scanned, Steps};
use crate::label_borders::{Tiling, steps_at_pixel_borders, steps_at_point_borders};

#[pyclass(name = "Steps", frozen, get_all)]
pub(super) struct PySteps {
    range_m: Py<PyArray1<f32>>,
    to_range_step_m: Py<PyArray2<f32>>,
    to_intensity_step_m: Py<PyArray2<f32>>,
    spacing: f64,
    axis: Option<[f64; 3]>,
    intensity: Option<Py<PyArray1<f32>>>,
}

/// Points of a sweep, intensities and rings.
type PySweep<'py> =
    (PyReadonlyArray2<'py, f32>, Option<PyReadonlyArray1<'py, f32>>, Option<PyReadonlyArray1<'py, u16>>);

#[pyfunction]
pub(super) fn edge_steps(
    py: Python<'_>,
    sweeps: Vec<PySweep>,
    same_surface_m: f64,
) -> PyResult<Vec<PySteps>> {
    let points =
        sweeps.iter().map(|(points, ..)| borrowed_rows("points", points)).collect::<PyResult<Vec<_>>>()?;
    let sweeps = points
        .iter()
        .zip(&sweeps)
        .map(|(points, sweep)| scanned(points, sweep))
        .collect::<PyResult<Vec<_>>>()?;
    let steps = detached(|| edges::steps(&sweeps, same_surface_m));
    steps.iter().map(|steps| PySteps::new(py, steps)).collect()
}

fn scanned<'a>(points: &'a [[f32; 3]], (_, intensity, rings): &'a PySweep) -> PyResult<Scanned<'a>> {
    let intensity = intensity.as_ref().map(|values| values.as_slice()).transpose()?;
    let rings = rings.as_ref().map(|values| values.as_slice()).transpose()?;
    let counts = [intensity.map(<[f32]>::len), rings.map(<[u16]>::len)];
    if let Some(count) = counts.into_iter().flatten().find(|&count| count != points.len()) {
        return Err(value_error(format!("found {count} intensities or rings of {} points", points.len())));
    }
    Ok(Scanned { points, intensity, rings })
}

impl PySteps {
    fn new(py: Python<'_>, steps: &Steps) -> PyResult<Self> {
        Ok(Self {
            range_m: PyArray1::from_slice(py, &steps.range_m).unbind(),
            to_range_step_m: to_array2(py, &steps.to_range_step_m)?.unbind(),
            to_intensity_step_m: to_array2(py, &steps.to_intensity_step_m)?.unbind(),
            spacing: steps.spacing,
            axis: steps.axis.map(|axis| axis.into_inner().into()),
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
