"""The numeric core, in Rust. Angles in radians, metres, `(u, v)` pixels; see `rust/` for what each stage does."""

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import TypeAlias, final

import numpy as np
from numpy.typing import NDArray

_Float64: TypeAlias = NDArray[np.float64]
_Float32: TypeAlias = NDArray[np.float32]
_Grid: TypeAlias = tuple[int, int, float, float]
"""Rows, columns, elevation of the upper border and height of a cell of a spherical image."""

__all__ = [
    "Agreement",
    "AnchoredPoints",
    "Camera",
    "ClassShares",
    "Hypothesis",
    "LabelledCloud",
    "LabelledImage",
    "Observations",
    "PointCloud",
    "Renderer",
    "SemanticDistance",
    "SphericalImages",
    "Trajectory",
    "agreement",
    "align",
    "despeckle",
    "estimate_grid",
    "held_out_gain",
    "land",
    "parse_point_cloud",
    "polish",
    "quaternion",
    "read_class_shares",
    "read_label_images",
    "read_label_thumbnails",
    "read_point_clouds",
    "register",
    "sample_correspondences",
    "scan_grid",
    "sensitivity",
    "set_num_threads",
    "spherical_image",
    "student_quantile",
    "synthetic_classes",
]

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
    @property
    def limit(self) -> float:
        """The largest incidence angle, radians, at which the model holds."""
    @property
    def pixels_per_radian(self) -> float:
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
    @property
    def ids(self) -> NDArray[np.uint16]:
        """The classes that any of them has a share of, ascending."""

    @property
    def classes(self) -> NDArray[np.uint8]:
        """(N,) the class of the largest share of each; 255 where less than half is labelled."""

    def renamed(self, table: NDArray[np.uint8]) -> ClassShares:
        """The same with other classes: `table` (256,) gives the new one of each, 255 takes its share away."""

@final
class LabelledCloud:
    """Points (N, 3) and their classes (N,), copied once; shared by all observations that are made with it."""

    def __new__(
        cls, points: _Float32, classes: NDArray[np.uint8], shares: ClassShares | None
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
        frames: Sequence[tuple[LabelledCloud, LabelledImage]],
        num_point_classes: int,
        num_image_classes: int,
    ) -> Observations: ...

@final
class AnchoredPoints:
    """The labelled points of a level of the pyramid that land on labelled pixels at an anchor pose."""

    def __new__(
        cls, observations: Observations, anchor: _Float64, *, factor: int, edge_band: int, visible_only: bool
    ) -> AnchoredPoints: ...
    @property
    def classes(self) -> NDArray[np.uint8]:
        """(N,) of each point."""
    @property
    def weights(self) -> _Float32:
        """(N,) labelled share of the blocks under each point, at the anchor."""
    @property
    def unit_motions(self) -> _Float64:
        """(6, 6): columns are twists that each move the points by one block, independently of one another."""
    def shares(self, indices: NDArray[np.int64], t_camera_lidar: _Float64) -> _Float64:
        """Shares of each class (n, num_image_classes) under points (n,); rows add up to one, or to zero."""
    def pull_back(self, indices: NDArray[np.int64], t_camera_lidar: _Float64, gradient: _Float64) -> _Float64:
        """The gradient (3, 4) with respect to `t_camera_lidar` of what has `gradient` with respect to `shares`."""

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
        """The mean distance of points that land in the picture, averaged over classes; infinite if none does."""
    def minimize(
        self,
        t_camera_lidar: _Float64,
        *,
        step_rad: float,
        step_m: float,
        tolerance: float,
        max_rounds: int,
        max_restarts: int,
        max_points: int,
    ) -> tuple[_Float64, float, int, bool]:
        """Minimise it by Powell's method: the pose, its cost, costs computed, and whether it has settled."""

@final
class SphericalImages:
    """The spherical images of all frames on a grid: the labelled returns that are the nearest of a pixel."""

    def __new__(cls, observations: Observations, grid: _Grid) -> SphericalImages: ...

@final
class Hypothesis:
    """A placement of the picture on the sphere of LiDAR directions."""

    @property
    def num_pairs(self) -> int:
        """Labelled returns, of those that were looked at, that fall on a labelled pixel, over all frames."""

@final
class PointCloud:
    """A sweep without its no-returns: entries that were not finite or all zero."""

    @property
    def points(self) -> _Float32:
        """(N, 3) metres, LiDAR frame."""
    @property
    def intensity(self) -> _Float32 | None:
        """(N,) as recorded, where the format has it."""
    @property
    def ring(self) -> NDArray[np.uint16] | None:
        """(N,) the beam of each, where the cloud has a field of whole numbers for it."""
    @property
    def time(self) -> _Float64 | None:
        """(N,) seconds, from whatever moment the recorder counts."""
    @property
    def labels(self) -> NDArray[np.uint16] | None:
        """(N,) raw class ids, of the label file or else of the cloud's own label field."""
    @property
    def label_shares(self) -> ClassShares | None:
        """Probabilities of raw class ids instead, where the label file holds them."""
    @property
    def num_no_returns(self) -> int:
        """How many entries were left out."""
    @property
    def is_return(self) -> NDArray[np.bool_]:
        """Which of the file's entries are points."""

@final
class Trajectory:
    """How a LiDAR moves in a fixed frame."""

    @staticmethod
    def constant(twist_per_s: Sequence[float], stamp: float) -> Trajectory:
        """One twist at all times, metres and radians a second in the LiDAR frame; `stamp` is a time nearby."""
    @staticmethod
    def through(stamps: Sequence[float], poses: Sequence[_Float64]) -> Trajectory:
        """Through poses (4, 4) of the LiDAR in a fixed frame; raises `InputError` unless times ascend."""
    def twist_at(self, stamp: float) -> list[float]:
        """Metres and radians a second in the LiDAR frame, (6,), at a time; `ValueError` where none is known."""
    def compensate(self, points: _Float32, times: Sequence[float] | _Float64, moment: float) -> _Float32:
        """Points (N, 3), each measured at its time (N,), as they lie in the LiDAR frame of one moment, seconds.

        Raises `ValueError` where the trajectory does not reach.
        """

@final
class Agreement:
    """How well points and label images agree at a pose, over all frames."""

    @property
    def mutual_information(self) -> float:
        """Of visible points and the pixels around them, nats, plug-in estimate."""
    @property
    def bias(self) -> float:
        """Miller and Madow's estimate of how far the plug-in estimate is too high, nats."""
    @property
    def sigma(self) -> float:
        """Standard error of the estimate over parts of the pictures, nats; infinite if there is one part only."""
    @property
    def label_agreement(self) -> float:
        """Share of the visible pairs with positive pointwise mutual information."""
    @property
    def overlap(self) -> float:
        """Share of the picture's area that visible labelled points cover."""
    @property
    def num_inside(self) -> int:
        """Labelled points inside the picture."""
    @property
    def num_hidden(self) -> int:
        """Those of them that nearer returns hide from the camera."""
    @property
    def joint(self) -> _Float64:
        """(num_point_classes, num_image_classes) weights of the visible pairs."""

@final
class Renderer:
    """Renders synthetic streets for one rig."""

    def __new__(
        cls,
        camera: Camera,
        t_camera_lidar: _Float64,
        *,
        pattern: str,
        channels: int,
        columns: int,
        fov_up_deg: float,
        fov_down_deg: float,
        range_noise_m: float,
        dropout: float,
        max_range_m: float,
        tilt_deg: float,
    ) -> Renderer: ...
    def frame(
        self, seed: int, number: int
    ) -> tuple[_Float32, NDArray[np.uint32], NDArray[np.uint8], NDArray[np.uint8], NDArray[np.uint8], int]:
        """Render the frame of a number in the world of a seed.

        Returns:
            Points (N, 4) with intensity; labels (N,), `instance << 16 | class`; visibility (N,), 0 outside the
            picture, 1 hidden, 2 visible; image labels (H, W); picture (H, W, 3) RGB; objects in view.
        """

def sensitivity(
    observations: Observations,
    t_camera_lidar: _Float64,
    *,
    factor: int,
    edge_band: int,
    max_points: int,
    with_intrinsics: bool,
    regions_across: int,
) -> tuple[_Float64, _Float64, _Float64] | None:
    """How the mutual information depends on pose and intrinsics around a pose: see `rust/alignment/sensitivity.rs`.

    Returns:
        With n parameters, which are a twist on the left of the pose (metres, radians) and, if asked for, fx, fy, cx, cy
        (pixels) and k1: curvature (n, n), minus the second derivative in nats; scores (parts, n), the share of the
        gradient of each frame and square of the picture, nats; motions (n, n), mean products of the pixels by which the
        parameters move the points. None where no point lands on a label, or nothing changes the information.
    """

def student_quantile(probability: float, degrees_of_freedom: float) -> float:
    """The quantile of Student's t; raises `ValueError` unless degrees of freedom are above 0."""

def set_num_threads(num_threads: int) -> None:
    """Run the core on so many threads; results do not depend on it."""

def read_point_clouds(
    paths: Sequence[tuple[str | PathLike[str], str | PathLike[str] | None]],
) -> list[PointCloud]:
    """Read sweeps, each with its file of labels or, without one, with the labels of its own label field, if any.

    Raises:
        InputError: a file cannot be read or is not what its format promises, or counts differ.
    """

def parse_point_cloud(
    path: str | PathLike[str], npy: bytes, labels: str | PathLike[str] | None
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

def scan_grid(channels: int, columns: int, fov_up: float, fov_down: float) -> _Grid:
    """The grid of a spinning LiDAR, one row a channel."""

def estimate_grid(observations: Observations) -> _Grid:
    """The grid of a sensor that is not described.

    Channels are found in the histogram of elevations; a pattern without channels gets square cells that its points
    fill.

    Raises:
        CalibrationError: there are no points, or they span no elevations.
    """

def spherical_image(points: _Float32, grid: _Grid) -> NDArray[np.uint32]:
    """The index of the nearest return in each pixel; 2^32 - 1 where there is none."""

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

def despeckle(image_classes: Sequence[NDArray[np.uint8]]) -> list[tuple[NDArray[np.uint8], int]]:
    """Give isolated pixels of label images (H, W) the class around them, and count them."""

def register(
    observations: Observations,
    images: SphericalImages,
    *,
    zoom: str,
    coarse_cell: float,
    fine_cell: float,
    max_roll: float,
    roll_step: float,
    around: tuple[_Float64, float] | None,
    min_cells_of_most: float,
    num_hypotheses: int,
    separation: float,
) -> list[Hypothesis]:
    """Find the best well-separated placements of the pictures on the sphere, best first.

    `around` narrows the search to rotations within an angle of that of a `T_camera_lidar`.

    Raises:
        CalibrationError: no placement overlaps labelled points with labelled pixels.
    """

def sample_correspondences(
    observations: Observations,
    images: SphericalImages,
    zoom: str,
    hypotheses: Sequence[Hypothesis],
    count: int,
    seed: int,
) -> list[tuple[_Float64, _Float64]]:
    """Sample, for each hypothesis, points (N, 3) in the LiDAR frame and their pixels (N, 2).

    They are spread over the picture and over range.
    """

def align(
    observations: Observations,
    t_camera_lidar: Sequence[_Float64],
    *,
    factor: int,
    edge_band: int,
    visible_only: bool,
    steps: int,
    batch_size: int,
    step_size: float,
    final_step: float,
    max_baseline: float,
    max_points: int,
    seed: int,
) -> list[tuple[_Float64, float, int, float]]:
    """Let poses climb the mutual information of points and blocks of `factor x factor` pixels, over SE(3).

    Returns:
        For each, the pose (4, 4), the mutual information there less its bias, in nats, the number of points, and by how
        many blocks the pose still drifted at the end.
    """

def polish(
    observations: Observations,
    t_camera_lidar: _Float64,
    *,
    factor: int,
    edge_band: int,
    visible_only: bool,
    max_rounds: int,
    max_steps: int,
    tolerance: float,
    max_baseline: float,
    inverse_curvature: _Float64 | None = ...,
) -> tuple[_Float64, float, _Float64 | None]:
    """Bring a pose to the top of the mutual information of all points, deterministically.

    Returns:
        The pose (4, 4), by how many blocks the last round moved the points, and the inverse (6, 6) of minus the second
        derivative, with which a polish near by may begin; None where nothing changes the information.
    """

def held_out_gain(
    observations: Observations, held_out: Observations, before: _Float64, after: _Float64
) -> tuple[float, float]:
    """How much better held-out data agree at one pose than at another, nats, and its standard error.

    Tables of pointwise mutual information are those of `observations` at each pose.
    """

def agreement(observations: Observations, t_camera_lidar: _Float64) -> Agreement:
    """Compare points and label images at a pose."""

def land(
    camera: Camera, points: _Float32, t_camera_lidar: _Float64
) -> tuple[_Float64, _Float64, NDArray[np.bool_]]:
    """Where points land: pixels (N, 2), NaN outside the picture; ranges (N,) from the camera; who is hidden."""

def quaternion(t: _Float64) -> list[float]:
    """The rotation of a rigid transform (4, 4) as a unit quaternion x, y, z, w with w >= 0."""

def synthetic_classes() -> list[tuple[int, str]]:
    """Ids and names of the classes of synthetic streets, which are CARLA's."""
