//! The Python face of the core: checks, copies in, releases the GIL, calls, copies out.

mod agreement;
mod alignment;
mod anchored;
mod arrays;
mod camera;
mod configs;
mod edges;
mod errors;
mod label_borders;
mod labelling;
mod labels;
mod motion;
mod observations;
mod point_clouds;
mod poses;
mod registration;
mod segmentation;
mod semantic_distance;
mod spherical;
mod statistics;
mod threads;
mod unrolling;
mod world;

/// The core's functions and classes; `semcal_cli/_core.pyi` documents them.
#[pyo3::pymodule]
mod _core {
    #[pymodule_export]
    use super::agreement::{PyAgreement, PyHeldOutGain, agreement, held_out_gain};
    #[pymodule_export]
    use super::alignment::{
        PyAligned, PyAscended, PyJointMaximum, PyPolished, PySensitivity, align, ascend, information,
        information_along, information_gains, maximise, polish, sensitivity,
    };
    #[pymodule_export]
    use super::anchored::{PyAnchoredPoints, PyMiniBatch};
    #[pymodule_export]
    use super::camera::{PyCamera, PyProjected, project_points};
    #[pymodule_export]
    use super::configs::config_attributes;
    #[pymodule_export]
    use super::edges::{PySteps, edge_steps};
    #[pymodule_export]
    use super::label_borders::{steps_at_label_borders, steps_at_label_changes};
    #[pymodule_export]
    use super::labelling::{PyRangeProjection, PyRangeView, classes_of_scores, shares_of_scores};
    #[pymodule_export]
    const NO_PIXEL: u32 = crate::labelling::EMPTY;
    #[pymodule_export]
    const NO_VIEW: u8 = crate::labelling::NO_VIEW;
    #[pymodule_export]
    const NO_ID: u16 = crate::label_image::NO_ID;
    #[pymodule_export]
    use super::labels::{
        PyClassShares, despeckle, look_up_classes, read_class_shares, read_label_images,
        read_label_thumbnails, seen_ids,
    };
    #[pymodule_export]
    use super::motion::PyTrajectory;
    #[pymodule_export]
    use super::observations::{PyLabelledCloud, PyLabelledImage, PyObservations};
    #[pymodule_export]
    use super::point_clouds::{PyPointCloud, parse_point_cloud, read_point_clouds};
    #[pymodule_export]
    use super::poses::quaternion;
    #[pymodule_export]
    use super::registration::{PyCorrespondences, PyHypothesis, register, sample_correspondences};
    #[pymodule_export]
    const NO_SEGMENT: u32 = crate::segmentation::NO_SEGMENT;
    #[pymodule_export]
    const GROUND: u8 = crate::segmentation::Kind::Ground as u8;
    #[pymodule_export]
    const OBJECT: u8 = crate::segmentation::Kind::Object as u8;
    #[pymodule_export]
    use super::segmentation::{
        PyPartitions, PySegmentedSweep, PyUp, estimate_up, segment_sweep, segment_sweeps, turned_partitions,
    };
    #[pymodule_export]
    use super::semantic_distance::{PyDistanceMinimum, PySemanticDistance};
    #[pymodule_export]
    use super::spherical::{PyGrid, PySphericalImages, estimate_grid, scan_grid};
    #[pymodule_export]
    use super::statistics::{fisher_limit, student_quantile};
    #[pymodule_export]
    use super::threads::set_num_threads;
    #[pymodule_export]
    use super::unrolling::unroll;
    #[pymodule_export]
    use super::world::{PyRenderedFrame, PyRenderer, synthetic_classes};
}
