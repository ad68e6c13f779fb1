"""The numeric core, in Rust. Angles in radians, metres, `(u, v)` pixels; see `rust/` for what each stage does."""

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Protocol, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from semcal_cli.config import (
    AlignmentConfig,
    AscentConfig,
    ExactConfig,
    InitializationConfig,
    PolishConfig,
    SensitivityConfig,
)
from semcal_cli.config.synthetic import SynthConfig

_Float64: TypeAlias = NDArray[np.float64]
_Float32: TypeAlias = NDArray[np.float32]

__all__ = [
    "GROUND",
    "NO_ID",
    "NO_PIXEL",
    "NO_SEGMENT",
    "NO_VIEW",
    "OBJECT",
    "SHIFT_STEP_M",
    "Agreement",
    "Aligned",
    "AnchoredPoints",
    "Ascended",
    "Camera",
    "ClassShares",
    "Correspondences",
    "DistanceMinimum",
    "Grid",
    "Hypothesis",
    "InformationGain",
    "JointMaximum",
    "LabelledCloud",
    "LabelledImage",
    "MiniBatch",
    "NearestRanges",
    "Observations",
    "Partitions",
    "PointCloud",
    "Polished",
    "Projected",
    "RangeProjection",
    "RangeView",
    "RenderedFrame",
    "Renderer",
    "SegmentedSweep",
    "SemanticDistance",
    "Sensitivity",
    "SphericalImages",
    "Steps",
    "Trajectory",
    "Up",
    "agreement",
    "align",
    "ascend",
    "classes_of_scores",
    "config_attributes",
    "count_beside",
    "despeckle",
    "edge_steps",
    "estimate_grid",
    "estimate_up",
    "fisher_limit",
    "held_out_gain",
    "information",
    "information_along",
    "information_gains",
    "look_up_classes",
    "maximise",
    "nearest_ranges",
    "parse_point_cloud",
    "polish",
    "project_points",
    "quaternion",
    "read_class_shares",
    "read_label_images",
    "read_label_thumbnails",
    "read_point_clouds",
    "register",
    "sample_correspondences",
    "scan_grid",
    "seen_ids",
    "segment_sweeps",
    "sensitivity",
    "set_num_threads",
    "shares_alike",
    "shares_of_scores",
    "steps_at_label_borders",
    "steps_at_label_changes",
    "student_quantile",
    "sweep_shifts",
    "synthetic_classes",
    "turned_partitions",
    "unroll",
]

NO_SEGMENT: int
"""The id of a point in no segment."""
GROUND: int
OBJECT: int
"""Kinds of segments."""
NO_ID: int
"""The id of a pixel or a point that the network does not see."""
NO_PIXEL: int
"""Index of a pixel without a point, or of a point without a pixel."""
NO_VIEW: int
"""The view of a pixel that is in no view."""
SHIFT_STEP_M: float
"""Precision of `sweep_shifts`."""

class _DescentConfig(Protocol):
    """What the core reads of the settings of a descent."""

    @property
    def step_deg(self) -> float: ...
    @property
    def step_m(self) -> float: ...
    @property
    def tolerance(self) -> float: ...
    @property
    def max_rounds(self) -> int: ...
    @property
    def max_restarts(self) -> int: ...
    @property
    def max_points(self) -> int: ...

class _SegmentationConfig(Protocol):
    """What the core reads of the settings of a segmentation."""

    @property
    def ground_tolerance_m(self) -> float: ...
    @property
    def ground_cell_m(self) -> float: ...
    @property
    def object_gap_m(self) -> float: ...
    @property
    def object_gap_rays(self) -> float: ...
    @property
    def object_cell_m(self) -> float: ...
    @property
    def min_points(self) -> int: ...

class _Neighbors(Protocol):
    """What the core reads of the settings of a vote of neighbours."""

    @property
    def count(self) -> int: ...
    @property
    def search(self) -> int: ...
    @property
    def sigma_px(self) -> float: ...
    @property
    def max_difference_m(self) -> float: ...

@final
class Camera:
    """A calibrated camera; raises `InputError` for an unknown model, wrong coefficients or wrong parameters."""

    def __new__(
        cls,
        model: str,
        width: int,
        height: int,
        k: Sequence[Sequence[float]],
        distortion: Sequence[float],
        parameters: Mapping[str, float] = ...,
    ) -> Camera: ...
    limit: float
    """The largest incidence angle, radians, at which the model is valid."""
    pixels_per_radian: float
    """Columns per radian on the optical axis; not the focal length for a lens with a mirror or a sphere."""
    def project(self, points_camera: _Float64) -> _Float64:
        """Pixels (N, 2) of points (N, 3) in the camera frame; NaN where the model is not valid."""
    def unproject(self, pixels: _Float64) -> _Float64:
        """Unit rays (N, 3) in the camera frame of pixels (N, 2); NaN where the lens does not reach."""

@final
class ClassShares:
    """Class shares of many pixels or points from a network, in 1/255."""

    @staticmethod
    def certain(classes: NDArray[np.uint8]) -> ClassShares:
        """Return the shares of items (N,) that are each entirely of one class, or of none."""

    def __len__(self) -> int: ...
    ids: NDArray[np.uint16]
    """All classes with a share in any item, ascending."""
    classes: NDArray[np.uint8]
    """(N,) class with the largest share of each item; 255 where less than half is labelled."""

    def renamed(self, table: NDArray[np.uint8]) -> ClassShares:
        """Map the classes by `table` (256,), in which 255 drops the share of a class."""

@final
class LabelledCloud:
    """Points (N, 3) and their classes (N,), copied once and shared by all observations made with them."""

    def __new__(
        cls,
        points: _Float32,
        classes: NDArray[np.uint8],
        shares: ClassShares | None = None,
        partitions: Partitions | None = None,
        plain_class: int | None = None,
    ) -> LabelledCloud: ...

@final
class LabelledImage:
    """A label image (H, W), copied once and shared by all observations made with it."""

    def __new__(
        cls, classes: NDArray[np.uint8], shares: ClassShares | None = None, blur_px: float | None = None
    ) -> LabelledImage: ...

@final
class Observations:
    """All frames as the core stores them; raises `InputError` if counts, sizes or classes disagree."""

    def __new__(
        cls,
        camera: Camera,
        frames: Sequence[tuple[LabelledCloud, LabelledImage, float, int]],
        num_point_classes: int,
        num_image_classes: int,
        max_baseline_m: float,
        edge_band_px: int,
        origin_m: Sequence[float],
        by_classes: bool = False,
    ) -> Observations: ...

@final
class AnchoredPoints:
    """The labelled points of a pyramid level that project to labelled pixels at an anchor pose."""

    def __new__(
        cls,
        observations: Observations,
        anchor: _Float64,
        *,
        factor: int,
        visible_only: bool,
        max_points: int = ...,
        constant_radius: int = 0,
    ) -> AnchoredPoints:
        """Choose about `max_points` of the points in the images.

        Points at least `constant_radius` blocks inside one class are summed up once and never drawn. Zero turns this
        off.
        """
    classes: NDArray[np.uint8]
    """(N,) class of each point that may be drawn."""
    preconditioner: _Float64
    """(6, 6) columns are twists that each move the points by one block, independently of one another."""
    def sample(self, indices: NDArray[np.int64], t_camera_lidar: _Float64) -> MiniBatch:
        """Sample the label images under points (n,) at a pose, which need not be rigid."""

@final
class MiniBatch:
    """Points of a level at a pose, and the class shares of the blocks under them.

    Points on blocks of one class share a row. A row follows for each point on blocks of several classes.
    """

    weights: _Float64
    """(R, num_point_classes) weights of the point classes, as at the anchor."""
    shares: _Float64
    """(R, num_image_classes) shares of the pixel classes; rows sum to one."""
    def pull_back(self, gradient: _Float64) -> _Float64:
        """Return the gradient (3, 4) with respect to the pose, given `gradient` with respect to `shares`."""

@final
class SemanticDistance:
    """Distance of projected points from the pixels of their own class: the cost of SOIC, in pixels."""

    def __new__(
        cls, camera: Camera, parts: Sequence[tuple[int, _Float32, _Float32]], *, block: int
    ) -> SemanticDistance:
        """Take parts: a class number, its points (N, 3) in one frame, and the distances to its pixels there.

        Distances (rows, columns) are those of blocks of `block` x `block` pixels.
        """
    def at(self, t_camera_lidar: _Float64) -> float:
        """Return the mean distance of points inside the image, averaged over classes; infinite without any."""
    def minimize(self, t_camera_lidar: _Float64, config: _DescentConfig) -> DistanceMinimum:
        """Minimise the cost by Powell's method; raises `CalibrationError` if no point is inside the image."""

@final
class DistanceMinimum:
    """The minimum of the cost of SOIC."""

    T_camera_lidar: _Float64
    """(4, 4)."""
    cost_px: float
    """Cost at the minimum."""
    num_evaluations: int
    """Number of evaluations of the cost."""
    converged: bool
    """Whether the last restarts brought no gain."""

@final
class Grid:
    """The angular grid of a spherical image. Row 0 is the highest; columns cover a full turn."""

    rows: int
    """Number of rows, from top to bottom."""
    columns: int
    """Number of columns in a full turn."""
    top: float
    """Elevation of the upper border, radians."""
    cell_height: float
    """Height of a cell, radians."""

@final
class SphericalImages:
    """Spherical images of all frames on a grid: the labelled return nearest to the sensor in each pixel."""

    def __new__(cls, observations: Observations, grid: Grid) -> SphericalImages: ...

@final
class Hypothesis:
    """A placement of the image on the sphere of LiDAR directions."""

    mutual_information: float
    """Mutual information of the pairs, nats, less its bias."""
    num_pairs: int
    """Number of labelled returns used that project to a labelled pixel, over all frames."""

@final
class Correspondences:
    """Points and the pixels to which a hypothesis maps them."""

    points: _Float64
    """(N, 3) metres, LiDAR frame."""
    pixels: _Float64
    """(N, 2), (u, v)."""

@final
class PointCloud:
    """A sweep without its no-returns: entries that were not finite or all zero."""

    points: _Float32
    """(N, 3) metres, LiDAR frame."""
    intensity: _Float32 | None
    """(N,) as recorded; None if the format has none."""
    ring: NDArray[np.uint16] | None
    """(N,) beam of each point; None if the cloud has no integer field for it."""
    time: _Float64 | None
    """(N,) seconds, from an epoch that the recorder chose."""
    labels: NDArray[np.uint16] | None
    """(N,) raw class ids from the label file or else from the cloud's own label field."""
    label_shares: ClassShares | None
    """Probabilities of raw class ids instead, if the label file holds them."""
    num_no_returns: int
    """Number of entries that are not finite or all zero, which are left out."""
    is_kept: NDArray[np.bool_]
    """Which of the file's entries are the points: those of other LiDARs are left out, too."""

@final
class Trajectory:
    """Motion of a LiDAR in a fixed frame."""

    @staticmethod
    def constant(twist_per_s: Sequence[float], stamp: float) -> Trajectory:
        """Create a constant twist, metres and radians per second in the LiDAR frame, near the time `stamp`."""
    @staticmethod
    def through(stamps: Sequence[float], poses: Sequence[_Float64]) -> Trajectory:
        """Create a trajectory through two or more poses (4, 4) of the LiDAR in a fixed frame.

        Raises `InputError` unless each has a time and times ascend.
        """
    def twist_at(self, stamp: float) -> list[float]:
        """Return the twist (6,) at a time, metres and radians per second in the LiDAR frame.

        Raises `ValueError` if it is unknown.
        """
    def compensate(self, points: _Float32, times: _Float64, moment: float) -> _Float32:
        """Move points (N, 3), each measured at its time (N,), to the LiDAR frame of one moment, seconds.

        Raises `ValueError` if the trajectory does not cover a time.
        """

@final
class Agreement:
    """Agreement of points and label images at a pose, over all frames."""

    mutual_information: float
    """Mutual information of visible points and the pixels around them, nats, plug-in estimate."""
    bias: float
    """Miller and Madow's estimate of the upward bias of the plug-in estimate, nats."""
    sigma: float
    """Standard error of the estimate over parts of the images, nats; infinite with a single part."""
    label_agreement: float
    """Share of the visible pairs with positive pointwise mutual information."""
    overlap: float
    """Share of the image's area that visible labelled points cover."""
    num_inside: int
    """Number of labelled points inside the image."""
    num_hidden: int
    """Number of these points that nearer returns occlude from the camera."""
    joint: _Float64
    """(num_point_classes, num_image_classes) weights of the visible pairs."""
    frame_joints: _Float64
    """(frames, num_point_classes, num_image_classes) contribution of each frame to `joint`."""

@final
class InformationGain:
    """Gain in information from one pose to another."""

    @staticmethod
    def of_parts(gains: Sequence[float]) -> InformationGain:
        """Sum the gains of independent parts; the standard error is infinite with fewer than two."""
    gain: float
    """Gain in nats for classes, in adjusted mutual information (a share) for segments."""
    sigma: float
    """Standard error of the gain over parts of the images; infinite with fewer than two."""
    significance: float
    """Gain in standard errors; 0 if they are infinite."""

@final
class Ascended:
    """The end of an ascent."""

    T_camera_lidar: _Float64
    """(4, 4)."""
    num_points: int
    """Number of labelled points on labelled blocks at the start, from which batches were drawn."""
    drift: float
    """Distance in blocks between the mean positions in the last two quarters; small after convergence.

    Steps count in full even where the maximum baseline prevents them.
    """

@final
class Aligned:
    """The end of one of several ascents to compare."""

    T_camera_lidar: _Float64
    """(4, 4)."""
    value: float
    """The objective at the end: mutual information less its bias, nats (adjusted for segments, a share); signed
    information, nats; or contrast, levels."""
    num_points: int
    """Number of labelled points on labelled blocks at the end."""
    drift: float
    """Distance in blocks between the mean positions in the last two quarters; small after convergence.

    Steps count in full even where the maximum baseline prevents them.
    """

@final
class Polished:
    """The end of a polish."""

    T_camera_lidar: _Float64
    """(4, 4)."""
    moved_px: float
    """Root-mean-square distance by which the last round moved the points, or still tried to move them."""
    inverse_curvature: _Float64 | None
    """(6, 6) inverse of the negative Hessian, from which a nearby polish may start.

    None where the information is constant.
    """

@final
class Sensitivity:
    """Dependence of the mutual information on n variables around a pose.

    The first six are a twist on the left of the pose (metres, radians); intrinsics and the time offset may follow.
    """

    curvature: _Float64
    """(n, n) negative Hessian, nats."""
    scores: _Float64
    """(parts, n) contribution to the gradient of each class's points in each square of each image, nats."""
    motions: _Float64
    """(n, n) mean outer products of the points' displacements by the variables, pixels."""
    parts: NDArray[np.uint32]
    """(parts, 4) frame, row and column of the square, and point class of each part.

    For segments, the class is that of the image under them, numbered after those of points.
    """
    frame_curvatures: _Float64
    """(frames, n, n) contribution of each frame to `curvature`, nats."""
    class_curvatures: _Float64
    """(classes, n, n) contribution of each class, numbered as in `parts`, to `curvature`, nats."""

@final
class Projected:
    """Points in an image."""

    pixels: _Float64
    """(N, 2), (u, v); NaN outside the image."""
    ranges: _Float64
    """(N,) metres from the camera; NaN outside the image."""
    is_hidden: NDArray[np.bool_]
    """(N,) whether a nearer return occludes the point from the camera."""

@final
class Renderer:
    """Renders synthetic streets for one camera and one LiDAR of a rig."""

    def __new__(
        cls,
        camera: Camera,
        t_camera_rig: _Float64,
        config: SynthConfig,
        t_rig_lidar: _Float64 | None = None,
        lidar_number: int = 0,
    ) -> Renderer:
        """Prepare a rig, whose frame is that of its first LiDAR, with the pose and the number of the LiDAR to render.

        Raises `InputError` if the LiDAR has no rays, or the camera or the LiDAR is too far from the first one.
        """
    def frame(self, seed: int, number: int, twist_per_s: Sequence[float] | None = None) -> RenderedFrame:
        """Render one frame, by the seed of the world and the frame's number.

        With a twist (6,), metres and radians per second in the frame of the first LiDAR, the rig moves meanwhile.
        """

@final
class RenderedFrame:
    """One sweep and one image of a rig."""

    points: _Float32
    """(N, 4) x, y, z in metres, in the LiDAR frame at the time of each point, and intensity."""
    point_times: _Float32
    """(N,) seconds from the start of the sweep."""
    point_labels: NDArray[np.uint32]
    """(N,) `instance << 16 | class`."""
    point_visibility: NDArray[np.uint8]
    """(N,) 0 outside the image, 1 occluded, 2 visible."""
    image_labels: NDArray[np.uint8]
    """(H, W) classes."""
    image_rgb: NDArray[np.uint8]
    """(H, W, 3)."""
    num_objects: int
    """Number of distinct objects in the image or among the returns."""

@final
class JointMaximum:
    """Maximum of the mutual information over the pose, intrinsics and the time offset."""

    T_camera_lidar: _Float64
    """(4, 4)."""
    changes: list[float]
    """Changes of the intrinsics."""
    offset_s: float
    """Time offset of the images, seconds; positive if they were taken later than stamped."""
    moved_px: float
    """Root-mean-square distance by which the last round moved the points, or still tried to move them."""

def maximise(
    observations: Observations,
    t_camera_lidar: _Float64,
    config: AscentConfig,
    intrinsics: Sequence[str] = ...,
    twists_per_s: Sequence[Sequence[float]] | None = None,
) -> JointMaximum:
    """Maximise the mutual information over the pose and other variables: see `rust/alignment/joint.rs`.

    Intrinsics are fx, fy, cx, cy, or the index of a number of the lens. If a twist (6,) of the LiDAR is given for each
    frame, the time offset is a variable, too. Raises `ValueError` if the camera lacks one of the variables.
    """

def sensitivity(
    observations: Observations,
    t_camera_lidar: _Float64,
    config: SensitivityConfig,
    intrinsics: Sequence[str] = ...,
    twists_per_s: Sequence[Sequence[float]] | None = None,
) -> Sensitivity | None:
    """Compute the sensitivity to pose, intrinsics and time offset: see `rust/alignment/sensitivity.rs`.

    Variables are those of `maximise`; `radial` is a small radial distortion on top of the lens. Returns None if no
    point projects to a label, or the information is constant.
    """

def fisher_limit(alpha: float, numerator: float, denominator: float) -> float:
    """Return the value that Fisher's F exceeds with probability `alpha`: see `rust/distributions.rs`.

    Raises `ValueError` unless `alpha` is above 0 and at most 0.1, and degrees of freedom are at least 1 and above 0.
    """

def student_quantile(probability: float, degrees_of_freedom: float) -> float:
    """Return a quantile of Student's t.

    Raises `ValueError` unless the probability is from 1e-9 to 1 - 1e-9 and the degrees of freedom are finite and at
    least 0.3.
    """

def set_num_threads(num_threads: int) -> None:
    """Set the number of threads of the core; results do not depend on it. Raises `ValueError` for more than 4096."""

def config_attributes() -> list[tuple[str, list[str]]]:
    """Return the attributes from which each setting of the core is read, by the setting's name in the core."""

def read_point_clouds(
    paths: Sequence[tuple[str | PathLike[str], str | PathLike[str] | None]],
    max_points: int = ...,
    columns: Sequence[str] | None = None,
    item_bytes: int = 4,
    seconds_per_unit: float | None = None,
    own_points: tuple[str, tuple[float, float]] | None = None,
) -> list[PointCloud]:
    """Read sweeps, each with the labels of its label file or else of the cloud's own label field, if any.

    Args:
        paths: Point cloud and label file of each sweep.
        max_points: Maximum number of points of a sweep, no-returns included.
        columns: Names of the columns of `.bin` files; None for the usual ones of the suffix.
        item_bytes: Size of a number of these files, 4 or 8.
        seconds_per_unit: Seconds of one unit of point times; None for integers of nanoseconds and floats of seconds.
        own_points: Field of the files, and the smallest and largest value that it has at the LiDAR's own points. Others
            are left out; None for all points.

    Raises:
        InputError: a file cannot be read, is too large or does not match its format, a sweep has more than
            `max_points` points or none of the LiDAR's own, or counts differ.
    """

def parse_point_cloud(
    path: str | PathLike[str],
    npy: bytes,
    labels: str | PathLike[str] | None,
    max_points: int = ...,
    seconds_per_unit: float | None = None,
    own_points: tuple[str, tuple[float, float]] | None = None,
) -> PointCloud:
    """Read the sweep of `path`, which was converted to an `.npy` array of records (N,) with named fields.

    Raises:
        InputError: as `read_point_clouds`.
    """

def read_label_images(
    paths: Sequence[str | PathLike[str]],
    width: int,
    height: int,
    palette: Sequence[tuple[int, int, int]] | None = None,
) -> list[NDArray[np.uint16]]:
    """Read label images (H, W) of raw ids.

    With a palette (red, green, blue of each class), images are colour-coded: ids are indices into the palette, or 65535
    for other colours.

    Raises:
        InputError: a file cannot be read, has several channels or is not of the palette's kind, or has another size.
    """

def scan_grid(channels: int, columns: int, fov_up: float, fov_down: float) -> Grid:
    """Return the grid of a spinning LiDAR, one row per channel."""

def estimate_grid(points: Sequence[_Float32]) -> Grid:
    """Estimate the grid of a sensor without a description from its sweeps (N, 3).

    Channels are found in the histogram of elevations; a pattern without channels gets square cells, which its
    points fill.

    Raises:
        CalibrationError: there are no points, or they span no elevations.
    """

def read_label_thumbnails(
    paths: Sequence[PathLike[str]],
    width: int,
    height: int,
    columns: int,
    rows: int,
    palette: Sequence[tuple[int, int, int]] | None = None,
) -> NDArray[np.uint16]:
    """Read evenly spread pixels (N, rows, columns) of label images in parallel; raises `InputError`."""

def read_class_shares(paths: Sequence[PathLike[str]], shape: tuple[int, ...]) -> list[ClassShares]:
    """Read `.npz` files of class probabilities of pixels, shape (H, W), or of points, shape (N,).

    Raises:
        InputError: a file cannot be read or holds something else.
    """

def seen_ids(ids: Sequence[NDArray[np.uint16]]) -> NDArray[np.bool_]:
    """Flag which of the 65536 ids occur in any of the contiguous arrays."""

def look_up_classes(ids: NDArray[np.uint16], table: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Look up the classes of a contiguous array of ids in a table (65536,), in the shape of the ids."""

def despeckle(image_classes: Sequence[NDArray[np.uint8]]) -> list[tuple[NDArray[np.uint8], int]]:
    """Replace the class of isolated pixels of label images (H, W) by the one around them, and count them."""

def count_beside(
    rays: _Float32, points: _Float32, angle: float, max_rays: int, same_m: float, same_share: float
) -> NDArray[np.uint16]:
    """Count the rays beside each point (N, 3) that end before it, at it and beyond it, and where some end before it.

    Rays (M, 3) and points are vectors from one origin, metres. The `max_rays` nearest rays within `angle`, radians, are
    compared. Ranges are the same if they differ by at most `same_m` and `same_share` of the point's range together.

    Returns:
        (N, 4) three numbers of rays, and the number of the point's four quadrants in which rays end before it.
    """

def steps_at_label_borders(
    image: NDArray[np.uint8], labels: LabelledImage, *, reach: int, tiles: tuple[int, int]
) -> _Float32:
    """Sum the colour steps at the borders of a label image, displaced by up to `reach` pixels.

    Takes an image (H, W, 3) and the numbers of rows and columns of tiles. Returns (tiles, 2 reach + 1, 2 reach + 1):
    entry [t, reach + y, reach + x] sums the steps x pixels right of the borders in tile t, and y below.
    """

def steps_at_label_changes(clouds: Sequence[LabelledCloud], *, reach: int, num_blocks: int) -> list[_Float32]:
    """Sum the range steps where labels change from one entry of a sweep to the next, displaced by entries.

    Returns (num_blocks, 2 reach + 1) for each cloud: entry [b, reach + s] sums the steps s entries after the changes in
    block b of consecutive entries.
    """

def register(
    observations: Observations,
    images: SphericalImages,
    config: InitializationConfig,
    around: tuple[_Float64, float] | None = None,
) -> list[Hypothesis]:
    """Find the best well-separated placements of the images on the sphere, best first.

    `around` narrows the search to rotations within an angle, radians, of a `T_camera_lidar`.

    Raises:
        CalibrationError: no placement overlaps labelled points with labelled pixels.
        InputError: the lens does not reach the middle of the image.
        ValueError: a step of the search is not above zero.
    """

def sample_correspondences(
    observations: Observations,
    images: SphericalImages,
    zoom: str,
    hypotheses: Sequence[Hypothesis],
    count: int,
    seed: int,
) -> list[Correspondences]:
    """Sample points and their pixels for each hypothesis, spread over the image and over range.

    Raises:
        InputError: the lens does not reach the middle of the image.
    """

def ascend(
    observations: Observations,
    t_camera_lidar: _Float64,
    config: AlignmentConfig | ExactConfig,
    *,
    factor: int,
    visible_only: bool,
    seed: int,
) -> Ascended:
    """Ascend the mutual information of points and blocks of `factor x factor` pixels over SE(3)."""

def align(
    observations: Observations,
    poses: Sequence[_Float64],
    config: AlignmentConfig | ExactConfig,
    *,
    factor: int,
    visible_only: bool,
    seed: int,
    is_signed: bool = False,
    contrast_weights: Sequence[float] | None = None,
) -> list[Aligned]:
    """Ascend from each pose as `ascend` does, and evaluate each end for comparison.

    With a sign, the information of a class of points counts negatively where its mean level is below that of class 0.
    With a weight for each class of points, contrast is ascended: the mean level under points of the other classes less
    that under points of class 0.
    """

def polish(
    observations: Observations,
    t_camera_lidar: _Float64,
    config: PolishConfig,
    inverse_curvature: _Float64 | None = None,
) -> Polished:
    """Maximise the mutual information of all visible points over the pose, deterministically."""

def held_out_gain(
    observations: Observations,
    held_out: Observations,
    before: _Float64,
    after: _Float64,
    seen_after: tuple[Observations, Observations] | None = None,
) -> InformationGain:
    """Compute the gain in agreement of held-out data from one pose to another.

    Tables of pointwise mutual information come from `observations` at each pose. `seen_after` holds both observations
    as seen by another camera, to which the second pose belongs.
    """

def agreement(observations: Observations, t_camera_lidar: _Float64) -> Agreement:
    """Compare points and label images at a pose."""

def information_along(
    observations: Observations, anchor: _Float64, lines: Sequence[tuple[Sequence[float], Sequence[float]]]
) -> list[list[float]]:
    """Compute the mutual information along lines through a pose, nats, over the points visible there.

    Args:
        observations: Labelled points and label images.
        anchor: (4, 4), T_camera_lidar.
        lines: Twist (6,) on the left of the anchor, and its factors at the samples.
    """

def project_points(
    camera: Camera, points: _Float32, t_camera_lidar: _Float64, origin_m: Sequence[float] = ...
) -> Projected:
    """Project points (N, 3), metres, LiDAR frame, and flag those that nearer ones occlude. Rays start at `origin_m`."""

def unroll(
    camera: Camera,
    readout: tuple[float, str],
    points: _Float32,
    seen_s: _Float64,
    twist_per_s: Sequence[float],
    t_camera_lidar: _Float64,
) -> tuple[_Float32, _Float64]:
    """Move points (N, 3), metres, LiDAR frame, each from its moment (N,) to that at which its line is exposed.

    `readout` is the time from the first line to the last, in seconds, and the direction; the twist (6,) is the LiDAR's,
    metres and radians per second in its own frame. Moments are seconds after the exposure of the middle line.
    """

def quaternion(t: _Float64) -> list[float]:
    """Return the rotation of a rigid transform (4, 4) as a unit quaternion x, y, z, w with w >= 0."""

def synthetic_classes() -> list[tuple[int, str]]:
    """Return ids and names of the classes of synthetic streets, which are CARLA's."""

@final
class Up:
    """The direction away from the ground, and the height above it."""

    direction: _Float64
    """(3,) unit vector, LiDAR frame."""
    height_m: float
    """Height of the sensor above the ground, metres."""

@final
class SegmentedSweep:
    """The segments of a sweep: cells of the ground, and objects on it."""

    ids: NDArray[np.uint32]
    """(N,) segment of each point, or `NO_SEGMENT`."""
    num_segments: int
    kinds: NDArray[np.uint8]
    """(num_segments,) `GROUND` or `OBJECT`; segments of the ground come first."""
    up: _Float64 | None
    """(3,) direction away from the ground, LiDAR frame; None if no ground was found and all is objects."""

@final
class Partitions:
    """The segments of a sweep's points, and null partitions, in which the segments are elsewhere."""

def turned_partitions(
    points: Sequence[_Float32], segmented: Sequence[SegmentedSweep], num_turns: int
) -> list[Partitions]:
    """Return the segments of a drive's sweeps (N, 3), each with `num_turns` null partitions.

    In a null partition the segments are as if the sweep had been rotated about the direction away from the ground, by a
    fraction of the azimuths that the sweeps cover.
    """

def information(observations: Observations, t_camera_lidar: _Float64) -> list[tuple[list[int], float, float]]:
    """Compute the information of points about pixels at a pose (4, 4), less that of null partitions.

    Returns the sum over the visible points of each square of the images, by frame, row and column, and their weight.
    The total sum over the total weight is the adjusted mutual information of segments, a share, or the mutual
    information of classes, nats.
    """

def information_gains(
    observations: Observations, before: _Float64, after: Sequence[_Float64]
) -> list[InformationGain]:
    """Compute the gains in mean `information` from one pose (4, 4) to each of the others.

    Points are those visible at the first pose. Gains are in nats for classes.
    """

def estimate_up(points: Sequence[_Float32]) -> Up | None:
    """Estimate the direction away from the ground from a drive's sweeps (N, 3), for any mounting of the LiDAR.

    Returns None if no plane has nearly all returns on one side.
    """

@final
class NearestRanges:
    """Range of the nearest point of a sweep in each cell of directions."""

def nearest_ranges(points: Sequence[_Float32]) -> list[NearestRanges]:
    """Compute the ranges of the nearest points of sweeps (N, 3), metres, LiDAR frame, in cells of 2 degrees."""

def shares_alike(sweeps: Sequence[NearestRanges]) -> NDArray[np.float64]:
    """Compute the share (F, F) of directions seen in either of two sweeps that have the same range in both."""

def sweep_shifts(pairs: Sequence[tuple[_Float32, _Float32]]) -> list[float | None]:
    """Measure how far the LiDAR moves over the ground between the two sweeps (N, 3) of each pair, metres.

    A shift is None where it cannot be seen. It is precise to `SHIFT_STEP_M`.
    """

def segment_sweeps(
    points: Sequence[_Float32], config: _SegmentationConfig, up: Sequence[float] | _Float64 | None = None
) -> list[SegmentedSweep]:
    """Segment a drive's sweeps (N, 3), metres, LiDAR frame, in parallel.

    Without `up`, the direction is estimated from all of them together.
    """

@final
class Steps:
    """Changes along the scan from each point of a sweep to its neighbours."""

    range_m: NDArray[np.float32]
    """(N,) how far the next ray reaches beyond the point's surface, on the side where that is more, metres.

    It is infinite if there is no return next to the point, and NaN if the point itself is not a return or the pattern
    of the scan has no ray next to it.
    """
    to_range_step_m: _Float32
    """(N, 3) vector from each point towards that neighbour's ray, metres, to where the surface ends."""
    to_intensity_step_m: _Float32
    """(N, 3) vector from each point half-way to the neighbour whose intensity differs more, metres."""
    spacing: float
    """Median angle between neighbouring rays, radians; 0 if there are none."""
    axis: list[float] | None
    """(3,) axis about which the LiDAR turns, LiDAR frame; None if the points are not in the order of a scan."""
    intensity: NDArray[np.float32] | None
    """(N,) larger intensity difference to a neighbour on the same surface; NaN if there is none."""

def edge_steps(
    sweeps: Sequence[tuple[_Float32, NDArray[np.float32] | None, NDArray[np.uint16] | None]],
    same_surface_m: float,
) -> list[Steps]:
    """Find the steps in range and intensity along the scans of sweeps, in parallel.

    Neighbours are those of the same laser if the points are in the order of the scan: one laser after the other, or in
    the order of each laser's scan if rings are given. Otherwise they are at about the same elevation.

    Args:
        sweeps: For each its points (N, 3), metres, from where the rays start, as scanned, in any order; their
            intensities (N,), or None; and their rings (N,), or None.
        same_surface_m: Largest range difference of points on one surface.

    Raises:
        ValueError: the numbers of points, intensities and rings of a sweep differ.
    """

def classes_of_scores(
    scores: Sequence[_Float32], views: NDArray[np.uint8], places: _Float32, classes_first: bool
) -> NDArray[np.uint16]:
    """Sample class scores at pixels, bilinear, and take the class with the highest, the lowest in a tie.

    Args:
        scores: Scores of each view: (C, h, w) with `classes_first`, otherwise (h, w, C).
        views: (N,) view of each pixel, or `NO_VIEW`.
        places: (N, 2) column and row of each pixel on the grid of its view's scores.
        classes_first: Whether classes are the first axis.

    Returns:
        (N,) classes; `NO_ID` for pixels in no view.

    Raises:
        InputError: a score is not finite.
    """

def shares_of_scores(
    scores: Sequence[_Float32],
    views: NDArray[np.uint8],
    places: _Float32,
    classes_first: bool,
    are_logits: bool,
) -> NDArray[np.uint8]:
    """Sample scores as `classes_of_scores`, and return the class shares (N * C,) in 1/255, pixel by pixel.

    The softmax is applied to logits; other scores are proportional to probabilities.

    Raises:
        InputError: a score is not finite.
    """

@final
class RangeProjection:
    """The points of a sweep in a range image."""

    points: NDArray[np.uint32]
    """(rows * columns,) nearest point of each pixel, or `NO_PIXEL`."""
    pixels: NDArray[np.uint32]
    """(N,) pixel of each point, or `NO_PIXEL`."""

@final
class RangeView:
    """A range image: rows from top to bottom, columns from left to right; raises `InputError` if it is impossible."""

    def __new__(
        cls,
        rows: int,
        columns: int,
        elevations: tuple[float, float],
        azimuths: tuple[float, float],
        clamps: bool,
    ) -> RangeView:
        """Take elevations of the lower and upper border, and azimuths of the left and right one, in radians."""

    def project(self, points: _Float32, rings: NDArray[np.uint16] | None = None) -> RangeProjection:
        """Project points (N, 3); with `rings` (N,), a point's row is its ring."""

    def carry_back(
        self,
        projection: RangeProjection,
        points: _Float32,
        classes: NDArray[np.uint16],
        neighbors: _Neighbors,
    ) -> NDArray[np.uint16]:
        """Transfer the classes of pixels back to points (N,) by their nearest neighbours; `NO_ID` does not vote."""
