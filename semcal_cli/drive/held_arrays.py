"""Arrays of a program in place of a drive's files: their names and their checks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypedDict

import numpy as np

from semcal_cli.drive.camera import Camera
from semcal_cli.errors import InputError, counted, describe, one_of
from semcal_cli.files.array_forms import COLORS, POINTS, Form, check_array
from semcal_cli.geometry.arrays import Array

POSES = "poses"
"""Name of the array with the LiDAR's poses, in place of their file."""
LISTS = {
    "points": "points",
    "point_labels": "point_labels",
    "image_labels": "image_labels",
    "images": "image",
    "point_features": "point_features",
    "image_features": "image_features",
}
"""The lists of arrays, with one array per frame, and the frame keys under which a drive names their files."""
STAMPS = {"points_stamps": "points_stamp", "image_stamps": "image_stamp"}
"""The lists of times, with one time per frame, and the frame keys that hold them."""
TIMES = "point_times"
"""The list of point times, which a drive has in the files of its sweeps."""
DRIVE_KEYS = (
    "camera",
    "lidar",
    "ignore",
    "classes",
    "motion",
    "synchronization",
    "time_offset_s",
    "time_offset_sigma_s",
    "T_camera_lidar",
)
"""Keys of a drive that are taken over unchanged."""
IDS = (np.integer,), "ids as whole numbers"
PROBABILITIES = (np.floating, np.uint8), "probabilities as floats or uint8"
SECONDS = (np.floating,), "seconds as floats"


class ArrayInput(TypedDict, total=False):
    """Input of a program in place of a drive: lists with one array per frame, and the keys of a drive.yaml.

    `points` and `camera` are always needed; each cue needs more, as with a drive. None stands for an array that a frame
    lacks. The arrays are not copied: do not write to them before the result is there.
    """

    points: Sequence[Array]
    """(N, 3) or (N, 4) metres, LiDAR frame, with the intensity in the fourth column. float32 is not converted. Entries
    that are not finite or all zero are not returns, and are left out with their labels and times."""
    camera: Camera
    """Camera of the images."""
    point_labels: Sequence[Array | None]
    """Class ids (N,) of the points, whole numbers from 0 to 65535, or probabilities (N, C)."""
    image_labels: Sequence[Array | None]
    """Class ids (H, W) of the pixels, or probabilities (H, W, C)."""
    images: Sequence[Array | None]
    """Images (H, W), or (H, W, 3) red, green, blue; uint8."""
    point_times: Sequence[Array | None]
    """Time of each point (N,), seconds as floats, relative to `points_stamps` unless the motion says `absolute`."""
    points_stamps: Sequence[float]
    """Time of each sweep, in seconds."""
    image_stamps: Sequence[float]
    """Time of each image, in seconds."""
    poses: Array
    """(M, 8) poses of the LiDAR in a fixed frame: seconds x y z qx qy qz qw. They determine the motion."""
    point_features: Sequence[Array | None]
    """Features (N, C) of the points."""
    image_features: Sequence[Array | None]
    """Features of the pixels (H, W, C), or of blocks of pixels (H / s, W / s, C)."""
    lidar: Any
    """Scan pattern of the LiDAR, as under `lidar` in a drive.yaml: a mapping, or `Lidar`."""
    ignore: Any
    """Ids that carry no information, as under `ignore` in a drive.yaml."""
    classes: Any
    """Names of classes and the raw ids merged into each, as under `classes` in a drive.yaml."""
    motion: Any
    """Motion of the LiDAR, as under `motion` in a drive.yaml; its `poses` can only be "poses", the array."""
    synchronization: str
    """What ties the images to the moments of the sweeps: `hardware`, `stamps` or `unknown`, as in a drive.yaml."""
    time_offset_s: float
    """Time by which images are later than `image_stamps` say, in seconds."""
    time_offset_sigma_s: float
    """Standard deviation of `time_offset_s`, in seconds."""
    T_camera_lidar: Any
    """(4, 4) reference transform, p_camera = T_camera_lidar @ p_lidar, metres, only for comparisons."""
    name: str
    """Name of the data in messages and in results; `arrays` if none is given."""


@dataclass(frozen=True, eq=False)
class HeldArrays:
    """The arrays of a drive, by the names that stand in place of file names."""

    by_name: Mapping[str, Array]

    def times_of(self, points: str) -> dict[str, Array]:
        """Return the point times of a sweep by name, with their own name; empty if there are none."""
        name = TIMES + points.removeprefix("points")
        return {name: self.by_name[name]} if name in self.by_name else {}


def document_of(arrays: ArrayInput) -> tuple[dict[str, Any], HeldArrays]:
    """Check arrays, and describe them as the document of a drive.

    Raises:
        InputError: an argument is missing, unknown or of the wrong form; the message names it.
    """
    argument_names = list(ArrayInput.__annotations__)
    for name in arrays.keys() - set(argument_names):
        raise InputError(f"{name}: found an unknown argument, expected {one_of(name, argument_names)}")
    if not isinstance(arrays.get("name", ""), str):
        raise InputError(f"name: found {describe(arrays['name'])}, expected text")
    camera, points = arrays.get("camera"), arrays.get("points")
    if not isinstance(camera, Camera):
        raise InputError(f"camera: found {type(camera).__name__}, expected semcal.Camera")
    if points is None or (_is_list(points) and len(points) == 0):
        raise InputError("points: found nothing, expected an array (N, 3) or (N, 4) for each frame")
    if not _is_list(points):
        raise InputError(
            f"points: found {type(points).__name__}, expected a list with an array for each frame"
        )
    frames: list[dict[str, Any]] = [{} for _ in points]
    by_name = dict[str, Array]()
    for argument in (*LISTS, TIMES):
        for index, array in _listed(arrays, argument, len(points)):
            name = f"{argument}[{index}]"
            check_array(name, array, _forms(argument, camera, points[index]))
            by_name[name] = array
            if argument in LISTS:
                frames[index][LISTS[argument]] = name
    for argument, key in STAMPS.items():
        for index, stamp in _listed(arrays, argument, len(points)):
            try:
                frames[index][key] = float(stamp)
            except (TypeError, ValueError):
                raise InputError(f"{argument}[{index}]: found {describe(stamp)}, expected seconds") from None
    document = {key: arrays[key] for key in DRIVE_KEYS if key in arrays}  # type: ignore[literal-required]
    if "poses" in arrays:
        check_array(POSES, arrays["poses"], [Form(("M", 8))])
        by_name[POSES] = arrays["poses"]
        document.setdefault("motion", {"poses": POSES})
    if isinstance(reference := document.get("T_camera_lidar"), np.ndarray):
        document["T_camera_lidar"] = reference.tolist()
    return {"semcal_drive": 1, **document, "frames": frames}, HeldArrays(by_name)


def _listed(arrays: ArrayInput, argument: str, count: int) -> Iterator[tuple[int, Any]]:
    """Yield the entries of a list that are not None, with their indices."""
    entries: Sequence[Any] | None = arrays.get(argument)  # type: ignore[assignment]
    if entries is None:
        return
    if not _is_list(entries):
        raise InputError(
            f"{argument}: found {type(entries).__name__}, expected a list with an entry for each frame"
        )
    if len(entries) != count:
        raise InputError(
            f"{argument}: found {counted(len(entries), 'entry')}, needed {count}, one for each entry of points"
        )
    yield from (
        (index, entry) for index, entry in enumerate(entries) if entry is not None or argument == "points"
    )


def _is_list(value: object) -> bool:
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


def _forms(argument: str, camera: Camera, points: Array) -> Sequence[Form]:
    """List the allowed forms of a frame's array."""
    size, count = (camera.height, camera.width), len(points) if isinstance(points, np.ndarray) else 0
    return {
        "points": POINTS,
        "point_labels": [Form((count,), *IDS), Form((count, "C"), *PROBABILITIES)],
        "image_labels": [Form(size, *IDS), Form((*size, "C"), *PROBABILITIES)],
        "images": [Form(size, *COLORS), Form((*size, 3), *COLORS)],
        "point_features": [Form((count, "C"))],
        "image_features": [Form(("H", "W", "C"))],
        TIMES: [Form((count,), *SECONDS)],
    }[argument]
