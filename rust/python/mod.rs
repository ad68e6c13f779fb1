//! Python bindings of the core: they check and copy arguments, release the GIL, call the core, and copy the
//! results.

mod alignment;
mod anchored;
mod arrays;
mod calls;
mod camera;
mod configs;
mod edges;
mod labelling;
mod labels;
mod lines_of_sight;
mod motion;
mod observations;
mod registration;
mod scenes;
mod segmentation;
mod semantic_distance;
mod statistics;
mod streets;

/// Functions and classes of the core; `semcal_cli/_core.pyi` documents them.
#[pyo3::pymodule]
mod _core {
    #[pymodule_export]
    const NO_PIXEL: u32 = crate::labelling::EMPTY;
    #[pymodule_export]
    const NO_VIEW: u8 = crate::labelling::NO_VIEW;
    #[pymodule_export]
    const NO_ID: u16 = crate::label_image::NO_ID;
    #[pymodule_export]
    const NO_SEGMENT: u32 = crate::segmentation::NO_SEGMENT;
    #[pymodule_export]
    const SHIFT_STEP_M: f64 = crate::sweep_shift::STEP_M;
    #[pymodule_export]
    const GROUND: u8 = crate::segmentation::SegmentKind::Ground as u8;
    #[pymodule_export]
    const OBJECT: u8 = crate::segmentation::SegmentKind::Object as u8;
    #[pymodule_export]
    use super::{
        alignment::{
            PyAgreement, PyAligned, PyAscended, PyInformationGain, PyJointMaximum, PyPolished, PySensitivity,
            agreement, align, ascend, held_out_gain, information, information_along, information_gains,
            maximise, polish, sensitivity,
        },
        anchored::{PyAnchoredPoints, PyMiniBatch},
        arrays::quaternion,
        calls::set_num_threads,
        camera::{PyCamera, PyProjected, project_points},
        configs::config_attributes,
        edges::{PySteps, edge_steps, steps_at_label_borders, steps_at_label_changes},
        labelling::{PyRangeProjection, PyRangeView, classes_of_scores, shares_of_scores},
        labels::{
            PyClassShares, PyPointCloud, despeckle, look_up_classes, parse_point_cloud, read_class_shares,
            read_label_images, read_label_thumbnails, read_point_clouds, seen_ids,
        },
        lines_of_sight::count_beside,
        motion::{PyTrajectory, unroll},
        observations::{PyLabelledCloud, PyLabelledImage, PyObservations},
        registration::{
            PyCorrespondences, PyGrid, PyHypothesis, PySphericalImages, estimate_grid, register,
            sample_correspondences, scan_grid,
        },
        scenes::{PyNearestRanges, nearest_ranges, shares_alike, sweep_shifts},
        segmentation::{
            PyPartitions, PySegmentedSweep, PyUp, estimate_up, segment_sweeps, turned_partitions,
        },
        semantic_distance::{PyDistanceMinimum, PySemanticDistance},
        statistics::{fisher_limit, student_quantile},
        streets::{PyRenderedFrame, PyRenderer, synthetic_classes},
    };
}
