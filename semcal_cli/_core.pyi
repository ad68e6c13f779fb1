"""The numeric core, in Rust. Angles in radians, metres, `(u, v)` pixels; see `rust/` for what each stage does."""

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from semcal_cli.config import (
    AlignmentConfig,
    ExactConfig,
    InitializationConfig,
    JointConfig,
    PolishConfig,
    SensitivityConfig,
)
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.cues.segments import SegmentationConfig
from semcal_cli.experiments.baselines.config import SoicConfig
from semcal_cli.labelling.card import NeighborsConfig

_Float64: TypeAlias = NDArray[np.float64]
_Float32: TypeAlias = NDArray[np.float32]

__all__ = [
    "GROUND",
    "NO_ID",
    "NO_PIXEL",
    "NO_SEGMENT",
    "NO_VIEW",
    "OBJECT",
    "Agreement",
    "Aligned",
    "AnchoredPoints",
    "Ascended",
    "Camera",
    "ClassShares",
    "Correspondences",
    "DistanceMinimum",
    "Grid",
    "HeldOutGain",
    "Hypothesis",
    "JointMaximum",
    "LabelledCloud",
    "LabelledImage",
    "MiniBatch",
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
    "segment_sweep",
    "segment_sweeps",
    "sensitivity",
    "set_num_threads",
    "shares_of_scores",
    "steps_at_label_borders",
    "steps_at_label_changes",
    "student_quantile",
    "synthetic_classes",
    "turned_partitions",
    "unroll",
]

NO_SEGMENT: int
"""The segment of a point that has none."""
GROUND: int
OBJECT: int
"""Kinds of segments."""
NO_ID: int
"""The id of a pixel or a point that a network does not see."""
NO_PIXEL: int
"""Index of a pixel without a point, or of a point without a pixel."""
NO_VIEW: int
"""The view of a pixel that no view shows."""

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
    """The largest incidence angle, radians, at which the model holds."""
    pixels_per_radian: float
    """Columns a radian on the optical axis; with a mirror or a sphere in the lens not the focal length."""
    def project(self, points_camera: _Float64) -> _Float64:
        """Pixels (N, 2) of points (N, 3) in the camera frame; NaN where the model does not hold."""
    def unproject(self, pixels: _Float64) -> _Float64:
        """Unit rays (N, 3) in the camera frame of pixels (N, 2); NaN where the lens does not reach."""

@final
class ClassShares:
    """Shares of classes of many pixels or points, in 1/255, as networks give them."""

    @staticmethod
    def certain(classes: NDArray[np.uint8]) -> ClassShares:
        """Those of items (N,) that are each all of one class, or of none."""

    def __len__(self) -> int: ...
    ids: NDArray[np.uint16]
    """The classes that any of them has a share of, ascending."""
    classes: NDArray[np.uint8]
    """(N,) the class of the largest share of each; 255 where less than half is labelled."""

    def renamed(self, table: NDArray[np.uint8]) -> ClassShares:
        """The same with other classes: `table` (256,) gives the new one of each, 255 takes its share away."""

@final
class LabelledCloud:
    """Points (N, 3) and their classes (N,), copied once; shared by all observations that are made with it."""

    def __new__(
        cls,
        points: _Float32,
        classes: NDArray[np.uint8],
        shares: ClassShares | None = None,
        partitions: Partitions | None = None,
    ) -> LabelledCloud: ...

@final
class LabelledImage:
    """A label image (H, W), likewise."""

    def __new__(cls, classes: NDArray[np.uint8], shares: ClassShares | None) -> LabelledImage: ...

@final
class Observations:
    """All frames, as the core keeps them; raises `InputError` where counts, sizes or classes disagree."""

    def __new__(
        cls,
        camera: Camera,
        frames: Sequence[tuple[LabelledCloud, LabelledImage, float]],
        num_point_classes: int,
        num_image_classes: int,
        by_classes: bool = False,
    ) -> Observations: ...

@final
class AnchoredPoints:
    """The labelled points of a level of the pyramid that land on labelled pixels at an anchor pose."""

    def __new__(
        cls,
        observations: Observations,
        anchor: _Float64,
        *,
        factor: int,
        edge_band_px: int,
        visible_only: bool,
        max_points: int = ...,
        constant_radius: int = 0,
    ) -> AnchoredPoints:
        """Choose the points, of at most `max_points`.

        Points that lie at least `constant_radius` blocks inside one class are summed up once, not drawn from; none are
        if it is zero.
        """
    classes: NDArray[np.uint8]
    """(N,) of each point that is drawn from."""
    preconditioner: _Float64
    """(6, 6): columns are twists that each move the points by one block, independently of one another."""
    def sample(self, indices: NDArray[np.int64], t_camera_lidar: _Float64) -> MiniBatch:
        """Sample the label images under points (n,) at a pose, which needs not be rigid."""

@final
class MiniBatch:
    """Points of a level at a pose, and the class shares of the blocks under them.

    Points on blocks of one class share a row, and a row follows for each point on blocks of several.
    """

    weights: _Float64
    """Weights of each class of points (R, num_point_classes), those of the anchor."""
    shares: _Float64
    """Shares of each class of pixels (R, num_image_classes); rows add up to one."""
    def pull_back(self, gradient: _Float64) -> _Float64:
        """The gradient (3, 4) with respect to the pose of what has `gradient` with respect to `shares`."""

@final
class SemanticDistance:
    """How far points land from the pixels of their own class: the cost of SOIC, in pixels."""

    def __new__(
        cls, camera: Camera, parts: Sequence[tuple[int, _Float32, _Float32]], *, block: int
    ) -> SemanticDistance:
        """Take parts: number of a class, its points (N, 3) in a frame, and the distances to its pixels there.

        Distances are those of blocks of `block` x `block` pixels, (rows, columns) of them.
        """
    def at(self, t_camera_lidar: _Float64) -> float:
        """The mean distance of points that land in the image, averaged over classes; infinite if none does."""
    def minimize(self, t_camera_lidar: _Float64, config: SoicConfig) -> DistanceMinimum:
        """Minimise it by Powell's method from a pose; raises `CalibrationError` if no point lands in the image."""

@final
class DistanceMinimum:
    """Where the cost of SOIC is least."""

    T_camera_lidar: _Float64
    """(4, 4)."""
    cost_px: float
    """The cost there."""
    num_evaluations: int
    """How many costs were computed."""
    converged: bool
    """Whether the last restarts gained nothing."""

@final
class Grid:
    """The angular grid of a spherical image. Row 0 is the highest; columns go all round."""

    rows: int
    """Cells from top to bottom."""
    columns: int
    """Cells around."""
    top: float
    """Elevation of the upper border, radians."""
    cell_height: float
    """Radians."""

@final
class SphericalImages:
    """The spherical images of all frames on a grid: the labelled returns that are the nearest of a pixel."""

    def __new__(cls, observations: Observations, grid: Grid) -> SphericalImages: ...
    grid: Grid
    """Grid of the images."""
    def classes(self, frame: int) -> NDArray[np.uint8]:
        """Label image (rows, columns) of a frame on the grid; 255 where no labelled return is."""

@final
class Hypothesis:
    """A placement of the image on the sphere of LiDAR directions."""

    mutual_information: float
    """Mutual information of the pairs, nats, less its bias."""
    num_pairs: int
    """Labelled returns, of those that were looked at, that fall on a labelled pixel, over all frames."""
    def zoomed(
        self, observations: Observations, images: SphericalImages, zoom: str, frame: int
    ) -> NDArray[np.uint8]:
        """Label image of a frame's image on the grid (rows, columns), placed so; 255 around it."""

@final
class Correspondences:
    """Points and the pixels that a hypothesis puts them on."""

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
    """(N,) as recorded, where the format has it."""
    ring: NDArray[np.uint16] | None
    """(N,) the beam of each, where the cloud has a field of whole numbers for it."""
    time: _Float64 | None
    """(N,) seconds, from whatever moment the recorder counts."""
    labels: NDArray[np.uint16] | None
    """(N,) raw class ids, of the label file or else of the cloud's own label field."""
    label_shares: ClassShares | None
    """Probabilities of raw class ids instead, where the label file holds them."""
    num_no_returns: int
    """How many entries were left out."""
    is_return: NDArray[np.bool_]
    """Which of the file's entries are points."""

@final
class Trajectory:
    """How a LiDAR moves in a fixed frame."""

    @staticmethod
    def constant(twist_per_s: Sequence[float], stamp: float) -> Trajectory:
        """One twist at all times, metres and radians a second in the LiDAR frame; `stamp` is a time nearby."""
    @staticmethod
    def through(stamps: Sequence[float], poses: Sequence[_Float64]) -> Trajectory:
        """Through two or more poses (4, 4) of the LiDAR in a fixed frame.

        Raises `InputError` unless each has a time and times ascend.
        """
    def twist_at(self, stamp: float) -> list[float]:
        """Metres and radians a second in the LiDAR frame, (6,), at a time; `ValueError` where none is known."""
    def compensate(self, points: _Float32, times: _Float64, moment: float) -> _Float32:
        """Points (N, 3), each measured at its time (N,), as they lie in the LiDAR frame of one moment, seconds.

        Raises `ValueError` where the trajectory does not reach.
        """

@final
class Agreement:
    """How well points and label images agree at a pose, over all frames."""

    mutual_information: float
    """Mutual information of visible points and the pixels around them, nats, plug-in estimate."""
    bias: float
    """Miller and Madow's estimate of how far the plug-in estimate is too high, nats."""
    sigma: float
    """Standard error of the estimate over parts of the images, nats; infinite if there is one part only."""
    label_agreement: float
    """Share of the visible pairs with positive pointwise mutual information."""
    overlap: float
    """Share of the image's area that visible labelled points cover."""
    num_inside: int
    """Labelled points inside the image."""
    num_hidden: int
    """Those of them that nearer returns hide from the camera."""
    joint: _Float64
    """(num_point_classes, num_image_classes) weights of the visible pairs."""
    frame_joints: _Float64
    """(frames, num_point_classes, num_image_classes) share of each frame in `joint`."""

@final
class HeldOutGain:
    """How much better held-out data agree at one pose than at another."""

    @staticmethod
    def of_parts(gains: Sequence[float]) -> HeldOutGain:
        """The sum of the gains of independent parts, with its standard error: infinite with fewer than two."""
    gain: float
    """Nats of classes; of segments, a share of their adjusted mutual information."""
    sigma: float
    """Its standard error over parts of the images; infinite if there are fewer than two."""

@final
class Ascended:
    """Where an ascent ended."""

    T_camera_lidar: _Float64
    """(4, 4)."""
    num_points: int
    """Labelled points on labelled blocks at its start, which it drew from."""
    drift: float
    """Blocks between the means of the way over the last two quarters: how far it was from settled.

    Steps count in full, also where the longest baseline keeps the pose from taking them.
    """

@final
class Aligned:
    """Where one of several ascents ended that are compared."""

    T_camera_lidar: _Float64
    """(4, 4)."""
    mutual_information: float
    """Mutual information of points and blocks there, less its bias, nats; of segments, adjusted, a share."""
    num_points: int
    """Labelled points on labelled blocks there."""
    drift: float
    """Blocks between the means of the way over the last two quarters: how far it was from settled.

    Steps count in full, also where the longest baseline keeps the pose from taking them.
    """

@final
class Polished:
    """Where a polish ended."""

    T_camera_lidar: _Float64
    """(4, 4)."""
    moved_px: float
    """How far the last round moved the points, or still wanted to move them, root mean square."""
    inverse_curvature: _Float64 | None
    """(6, 6) inverse of minus the second derivative, with which a polish near by may begin.

    None where nothing changes the information.
    """

@final
class Sensitivity:
    """How the mutual information depends on n variables around a pose.

    The first six are a twist on the left of the pose (metres, radians); intrinsics and the offset of the clock may
    follow.
    """

    curvature: _Float64
    """(n, n) minus the second derivative, nats."""
    scores: _Float64
    """(parts, n) share of the gradient of the points of each class in each square of each image, nats."""
    motions: _Float64
    """(n, n) mean products of the pixels by which the variables move the points."""
    parts: NDArray[np.uint32]
    """(parts, 4) frame, row and column of the square of each part, and the class of its points.

    That of segments is the class of the image under them, numbered after those of points.
    """
    frame_curvatures: _Float64
    """(frames, n, n) share of each frame in `curvature`, nats."""
    class_curvatures: _Float64
    """(classes, n, n) share of each class, as in `parts`, in `curvature`, nats."""

@final
class Projected:
    """Points in an image."""

    pixels: _Float64
    """(N, 2), (u, v); NaN outside the image."""
    ranges: _Float64
    """(N,) metres from the camera; NaN outside the image."""
    is_hidden: NDArray[np.bool_]
    """(N,) whether a nearer return hides the point from the camera."""

@final
class Renderer:
    """Renders synthetic streets for one rig."""

    def __new__(cls, camera: Camera, t_camera_lidar: _Float64, config: SynthConfig) -> Renderer:
        """Prepare a rig; raises `InputError` if the LiDAR has no rays or the camera is too far from it."""
    def frame(self, seed: int, number: int, twist_per_s: Sequence[float] | None = None) -> RenderedFrame:
        """Render the frame of a number in the world of a seed.

        With a twist (6,), metres and radians a second in the LiDAR frame, the rig moves while the frame is measured.
        """

@final
class RenderedFrame:
    """What a rig measures in one sweep and one image."""

    points: _Float32
    """(N, 4) metres, LiDAR frame of the time of each point, and intensity."""
    point_times: _Float32
    """(N,) seconds from the start of the sweep."""
    point_labels: NDArray[np.uint32]
    """(N,) `instance << 16 | class`."""
    point_visibility: NDArray[np.uint8]
    """(N,) 0 outside the image, 1 hidden, 2 visible."""
    image_labels: NDArray[np.uint8]
    """(H, W) classes."""
    image_rgb: NDArray[np.uint8]
    """(H, W, 3)."""
    num_objects: int
    """Distinct objects in the image or among the returns."""

@final
class JointMaximum:
    """Where the mutual information is largest in the pose, intrinsics and the offset of the clock together."""

    T_camera_lidar: _Float64
    """(4, 4)."""
    changes: list[float]
    """Changes of the intrinsics."""
    offset_s: float
    """Seconds by which images are later than they were taken to be."""
    moved_px: float
    """How far the last round moved the points, or still wanted to move them, root mean square."""

def maximise(
    observations: Observations,
    t_camera_lidar: _Float64,
    config: JointConfig,
    intrinsics: Sequence[str] = ...,
    twists_per_s: Sequence[Sequence[float]] | None = None,
) -> JointMaximum:
    """Bring a pose and other variables to the top of the mutual information: see `rust/alignment/joint.rs`.

    Intrinsics are fx, fy, cx, cy, or the index of a number of the lens. With a twist (6,) of the LiDAR in each frame
    the offset of the clock is a variable, too. Raises `ValueError` where the camera has not one of the variables.
    """

def sensitivity(
    observations: Observations,
    t_camera_lidar: _Float64,
    config: SensitivityConfig,
    intrinsics: Sequence[str] = ...,
    twists_per_s: Sequence[Sequence[float]] | None = None,
) -> Sensitivity | None:
    """How the mutual information depends on pose, intrinsics and clock: see `rust/alignment/sensitivity.rs`.

    Variables are those of `maximise`; `radial` is a small radial distortion on top of the lens. None where no point
    lands on a label, or nothing changes the information.
    """

def fisher_limit(alpha: float, numerator: float, denominator: float) -> float:
    """The value that Fisher's F exceeds with probability `alpha`: see `rust/distributions.rs`.

    Raises `ValueError` unless `alpha` is above 0 and at most 0.1, and degrees of freedom are at least 1 and above 0.
    """

def student_quantile(probability: float, degrees_of_freedom: float) -> float:
    """The quantile of Student's t.

    Raises `ValueError` unless the probability is from 1e-9 to 1 - 1e-9 and the degrees of freedom are finite and at
    least 0.3.
    """

def set_num_threads(num_threads: int) -> None:
    """Set the number of threads of the core; results do not depend on it. Raises `ValueError` for more than 4096."""

def config_attributes() -> list[tuple[str, list[str]]]:
    """The attributes that each of the core's settings is read from, by the name of the setting in the core."""

def read_point_clouds(
    paths: Sequence[tuple[str | PathLike[str], str | PathLike[str] | None]],
    max_points: int = ...,
) -> list[PointCloud]:
    """Read sweeps, each with its file of labels or, without one, with the labels of its own label field, if any.

    Raises:
        InputError: a file cannot be read, is too large or is not what its format promises, a sweep has more than
            `max_points` points, or counts differ.
    """

def parse_point_cloud(
    path: str | PathLike[str],
    npy: bytes,
    labels: str | PathLike[str] | None,
    max_points: int = ...,
) -> PointCloud:
    """Read the sweep at `path` from records (N,) of named fields that it was turned into, an array of NumPy's format.

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

    With a palette (red, green, blue of each class) they are colour-coded: ids are places in it, 65535 where it has no
    such colour.

    Raises:
        InputError: a file cannot be read, has several channels or is not of the palette's kind, or has another size.
    """

def scan_grid(channels: int, columns: int, fov_up: float, fov_down: float) -> Grid:
    """The grid of a spinning LiDAR, one row a channel."""

def estimate_grid(points: Sequence[_Float32]) -> Grid:
    """The grid of a sensor that is not described, from its sweeps (N, 3).

    Channels are found in the histogram of elevations; a pattern without channels gets square cells that its points
    fill.

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
    """Ids (N, rows, columns) of evenly spread pixels of label images, read in parallel; raises `InputError`."""

def read_class_shares(paths: Sequence[PathLike[str]], shape: tuple[int, ...]) -> list[ClassShares]:
    """Read `.npz` files of class probabilities: of pixels, shape (H, W), or of points, shape (N,).

    Raises:
        InputError: a file cannot be read or holds something else.
    """

def seen_ids(ids: Sequence[NDArray[np.uint16]]) -> NDArray[np.bool_]:
    """Tell of each of all 65536 ids whether one of the contiguous arrays has it."""

def look_up_classes(ids: NDArray[np.uint16], table: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Look up the classes of a contiguous array of ids in a table (65536,), in the shape of the ids."""

def despeckle(image_classes: Sequence[NDArray[np.uint8]]) -> list[tuple[NDArray[np.uint8], int]]:
    """Give isolated pixels of label images (H, W) the class around them, and count them."""

def steps_at_label_borders(
    picture: NDArray[np.uint8], image: LabelledImage, *, reach: int, tiles: tuple[int, int]
) -> _Float32:
    """Sum the steps of colour at the borders of a label image, displaced by up to `reach` pixels.

    Of an image (H, W, 3) and rows and columns of tiles; returns (tiles, 2 reach + 1, 2 reach + 1): at [t, reach + y,
    reach + x] that of the steps which lie x pixels right of the borders in tile t, and y below.
    """

def steps_at_label_changes(clouds: Sequence[LabelledCloud], *, reach: int, num_blocks: int) -> list[_Float32]:
    """Sum the steps of range where labels change from one entry of a sweep to the next, displaced by entries.

    Returns for each cloud (num_blocks, 2 reach + 1): at [b, reach + s] that of the steps which lie s entries after the
    changes in block b of consecutive entries.
    """

def register(
    observations: Observations,
    images: SphericalImages,
    config: InitializationConfig,
    around: tuple[_Float64, float] | None = None,
) -> list[Hypothesis]:
    """Find the best well-separated placements of the images on the sphere, best first.

    `around` narrows the search to rotations within an angle, radians, of that of a `T_camera_lidar`.

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
    """Sample, for each hypothesis, points and their pixels.

    They are spread over the image and over range.

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
    """Let a pose ascend the mutual information of points and blocks of `factor x factor` pixels, over SE(3)."""

def align(
    observations: Observations,
    poses: Sequence[_Float64],
    config: AlignmentConfig | ExactConfig,
    *,
    factor: int,
    visible_only: bool,
    seed: int,
) -> list[Aligned]:
    """Let poses ascend as `ascend` does, and tell how good each end is, so that they can be compared."""

def polish(
    observations: Observations,
    t_camera_lidar: _Float64,
    config: PolishConfig,
    inverse_curvature: _Float64 | None = None,
) -> Polished:
    """Bring a pose to the top of the mutual information of all visible points, deterministically."""

def held_out_gain(
    observations: Observations,
    held_out: Observations,
    before: _Float64,
    after: _Float64,
    seen_after: tuple[Observations, Observations] | None = None,
) -> HeldOutGain:
    """How much better held-out data agree at one pose than at another.

    Tables of pointwise mutual information are those of `observations` at each pose. `seen_after` are both observations
    as another camera sees them, to which the second pose belongs.
    """

def agreement(observations: Observations, t_camera_lidar: _Float64) -> Agreement:
    """Compare points and label images at a pose."""

def information_along(
    observations: Observations, anchor: _Float64, ways: Sequence[tuple[Sequence[float], Sequence[float]]]
) -> list[list[float]]:
    """Mutual information along ways from a pose, nats, of the points that are visible there.

    Args:
        observations: Labelled points and label images.
        anchor: (4, 4), T_camera_lidar.
        ways: Twist (6,) on the left of the anchor, and the factors of it at the samples.
    """

def project_points(camera: Camera, points: _Float32, t_camera_lidar: _Float64) -> Projected:
    """Project points (N, 3), metres, LiDAR frame, and tell which of them nearer ones hide."""

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
    metres and radians a second in its own frame. Moments are seconds after the exposure of the middle line.
    """

def quaternion(t: _Float64) -> list[float]:
    """The rotation of a rigid transform (4, 4) as a unit quaternion x, y, z, w with w >= 0."""

def synthetic_classes() -> list[tuple[int, str]]:
    """Ids and names of the classes of synthetic streets, which are CARLA's."""

@final
class Up:
    """The direction away from the ground, and how plain the ground is. Shares are of the area seen within 30 m."""

    direction: _Float64
    """(3,) unit vector, LiDAR frame."""
    height_m: float
    """The sensor above the ground."""
    share_on_plane: float
    """Share of what is seen that is on the ground's plane."""
    share_below: float
    """Share of what is seen that lies clearly below it."""

@final
class SegmentedSweep:
    """The segments of a sweep: cells of the ground, and objects that stand on it."""

    ids: NDArray[np.uint32]
    """(N,) segment of each point, or `NO_SEGMENT`."""
    num_segments: int
    kinds: NDArray[np.uint8]
    """(num_segments,) `GROUND` or `OBJECT`; those of the ground come first."""
    up: _Float64 | None
    """(3,) away from the ground, LiDAR frame; None where no ground was found, and everything is an object."""

@final
class Partitions:
    """The segments of a sweep's points, and null partitions, in which they lie elsewhere."""

def turned_partitions(
    points: Sequence[_Float32], segmented: Sequence[SegmentedSweep], num_turns: int
) -> list[Partitions]:
    """The segments of a drive's sweeps (N, 3), each with `num_turns` null partitions.

    In each the segments lie as if the sweep had been turned about the direction away from the ground, by equal parts
    of the azimuths that the sweeps cover.
    """

def information(
    observations: Observations, t_camera_lidar: _Float64, edge_band_px: int
) -> list[tuple[list[int], float, float]]:
    """What points tell of the pixels at a pose (4, 4): segments less what null partitions tell.

    For each square of the images, by frame, row and column: the sum over its visible points, and their weight. All
    sums over all weights are the adjusted mutual information of segments, a share, or that of classes, nats.
    """

def information_gains(
    observations: Observations, before: _Float64, after: Sequence[_Float64], edge_band_px: int
) -> list[HeldOutGain]:
    """The gains of that information, its mean over all points, from one pose (4, 4) to each of others.

    Points are those that are visible at the first pose. Classes tell their mutual information, in nats.
    """

def estimate_up(points: Sequence[_Float32]) -> Up | None:
    """The direction away from the ground of a drive's sweeps (N, 3), whichever way the LiDAR is mounted.

    None where no plane has nearly all returns on one side.
    """

def segment_sweep(
    points: _Float32, config: SegmentationConfig, up: Sequence[float] | _Float64 | None = None
) -> SegmentedSweep:
    """Segment a sweep (N, 3), metres, LiDAR frame. Without `up` the direction is estimated from the sweep."""

def segment_sweeps(
    points: Sequence[_Float32], config: SegmentationConfig, up: Sequence[float] | _Float64 | None = None
) -> list[SegmentedSweep]:
    """Segment a drive's sweeps in parallel. Without `up` the direction is estimated from all of them together."""

@final
class Steps:
    """What changes along the scan from each point of a sweep to its neighbours."""

    range_m: NDArray[np.float32]
    """(N,) by how much the farther one of the two neighbours is farther than the point, metres.

    It is infinite where no return is beside the point, and NaN where the point is no return itself.
    """
    to_range_step_m: _Float32
    """(N, 3) from each point to half-way towards that neighbour's ray, metres: the surface ends in between."""
    to_intensity_step_m: _Float32
    """(N, 3) from each point to half-way towards the neighbour whose intensity differs more, metres."""
    spacing: float
    """Median angle between neighbouring rays, radians; 0 without any."""
    intensity: NDArray[np.float32] | None
    """(N,) the larger difference of intensity to a neighbour on the same surface; NaN without such a neighbour."""

def edge_steps(
    points: Sequence[_Float32], intensities: Sequence[NDArray[np.float32] | None], same_surface_m: float
) -> list[Steps]:
    """Find the steps of range and intensity along the scans of sweeps, in parallel.

    Args:
        points: (N, 3) each, metres, LiDAR frame, as scanned, in any order.
        intensities: (N,) each, or None.
        same_surface_m: Points on one surface differ by less than this in range.

    Raises:
        InputError: there are not as many intensities as points.
    """

def classes_of_scores(
    scores: Sequence[_Float32], views: NDArray[np.uint8], places: _Float32, classes_first: bool
) -> NDArray[np.uint16]:
    """Sample scores of classes where pixels lie, bilinear, and take the class of the highest, the lowest of several.

    Args:
        scores: Scores of each view: (C, h, w) with `classes_first`, otherwise (h, w, C).
        views: (N,) the view of each pixel, or `NO_VIEW`.
        places: (N, 2) column and row of each pixel on the grid of its view's scores.
        classes_first: Whether classes are the first axis.

    Returns:
        (N,) classes; `NO_ID` where no view shows a pixel.

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
    """Sample scores as `classes_of_scores`, and give the share of each class in 1/255: (N * C,), pixel by pixel.

    Of logits, the softmax is taken; other scores are in proportion to probabilities.

    Raises:
        InputError: a score is not finite.
    """

@final
class RangeProjection:
    """The points of a sweep in a range image."""

    points: NDArray[np.uint32]
    """(rows * columns,) the nearest point of each pixel, or `NO_PIXEL`."""
    pixels: NDArray[np.uint32]
    """(N,) the pixel of each point, or `NO_PIXEL`."""

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
        """Angles in radians: elevations of the lower and the upper border, azimuths of the left and the right one."""

    def project(self, points: _Float32, rings: NDArray[np.uint16] | None = None) -> RangeProjection:
        """Project points (N, 3); with `rings` (N,), a point's row is its ring."""

    def carry_back(
        self,
        projection: RangeProjection,
        points: _Float32,
        classes: NDArray[np.uint16],
        neighbors: NeighborsConfig,
    ) -> NDArray[np.uint16]:
        """Carry the classes of pixels back to points (N,) by their nearest neighbours; `NO_ID` does not vote."""
