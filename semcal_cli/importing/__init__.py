"""Data sets: each has a reader that finds a recording in its native tree; `drive_folder` writes a drive of it.

This module imports nothing heavy, because the command line lists the data sets from its table.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from types import FunctionType
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from semcal_cli.errors import InputError, describe, listed, one_of
from semcal_cli.plugins import Plugins

if TYPE_CHECKING:
    from semcal_cli.importing.recording import Recording, Request

Reader = TypeVar("Reader", bound="Callable[[Request], Recording]")
OWN_OPTIONS = ("lidar", "version")
"""Fields of a `Request` that only those data sets of plugins have as options which declare them."""


class Dataset(NamedTuple):
    """A data set."""

    reader: str
    """Module in this folder, and its function that turns a `Request` into a `Recording`."""
    summary: str
    """One line of help."""
    signs: tuple[str, ...] = ()
    """Patterns of what is in ROOT, by which it is recognised if all of them match; `|` separates alternatives. Without
    any, it is only read by its name."""
    has_sequence_folders: bool = False
    """Whether the folder of a sequence, or the one that it is in, is recognised, too."""
    joins_sequences: bool = False
    """Whether the name of a folder of several sequences is that of a sequence of them all."""


DATASETS = {
    "kitti-odometry": Dataset(
        "kitti.read_odometry",
        "KITTI odometry: ROOT/sequences/00/velodyne; cameras image_0 to image_3, by default image_2.",
        ("sequences/*/velodyne",),
        has_sequence_folders=True,
    ),
    "semantickitti": Dataset(
        "kitti.read_semantickitti",
        "SemanticKITTI: KITTI odometry with ROOT/sequences/00/labels.",
        ("sequences/*/velodyne", "sequences/*/labels"),
        has_sequence_folders=True,
    ),
    "kitti-raw": Dataset(
        "kitti.read_raw",
        "KITTI raw: ROOT/2011_09_26/2011_09_26_drive_0001_sync; cameras image_00 to image_03, by default image_02.",
        ("*/*_sync/velodyne_points",),
        has_sequence_folders=True,
        joins_sequences=True,
    ),
    "kitti-object": Dataset(
        "kitti.read_object",
        "KITTI object: ROOT/training/velodyne; frames that share a calibration; cameras image_2 and image_3, by "
        "default image_2.",
        ("velodyne|training/velodyne", "image_[23]|training/image_[23]"),
    ),
    "kitti-360": Dataset(
        "kitti_360.read",
        "KITTI-360: ROOT/data_3d_semantics, or data_3d_raw; cameras image_00 to image_03, by default image_00.",
        ("data_3d_raw|data_3d_semantics", "calibration"),
    ),
    "rellis-3d": Dataset(
        "rellis_3d.read",
        "RELLIS-3D: ROOT/00000/os1_cloud_node_kitti_bin; one camera, pylon_camera_node.",
        ("[0-9][0-9][0-9][0-9][0-9]/os1_cloud_node_kitti_bin",),
        has_sequence_folders=True,
    ),
    "nuscenes": Dataset(
        "nuscenes.read",
        "nuScenes keyframes: ROOT/v1.0-mini, samples, lidarseg; sequences are scenes, such as scene-0061; cameras are "
        "channels, by default CAM_FRONT.",
        ("v1.0-*",),
    ),
    "carla": Dataset(
        "carla.read",
        "CARLA's `save_to_disk`: ROOT/ID/000001.ply and .png, and the rig in ROOT/sensors.json.",
        ("sensors.json",),
    ),
    "opencalib": Dataset(
        "opencalib.read",
        "OpenCalib's road frames: ROOT/1/calib.pcd, calib.txt and calib.png or .jpg.",
        ("calib.pcd|*/calib.pcd", "calib.txt|*/calib.txt"),
    ),
}
PLUGINS = Plugins("semcal.datasets", (*DATASETS, "bag", "folder"))
"""Data sets of other installed packages, which cannot take the names of semcal's own imports."""


def read_dataset(name: str, request: Request) -> Recording:
    """Find the frames, the camera and the reference in the native tree of a data set.

    Raises:
        InputError: there is no such data set; a file, a key, the sequence or the camera is missing or wrong; or no
            frame is complete.
        PluginError: the data set is a plugin's, which failed or returned no valid recording.
    """
    if name not in DATASETS:
        return _read_by_plugin(name, request)
    module, function = DATASETS[name].reader.split(".")
    recording: Recording = getattr(import_module(f"semcal_cli.importing.{module}"), function)(request)
    return recording


def _read_by_plugin(name: str, request: Request) -> Recording:
    from semcal_cli.importing.recording import check_recording

    if (read := PLUGINS.get(name, FunctionType)) is None:
        raise InputError(f"found data set {name!r}, expected {one_of(name, [*DATASETS, *PLUGINS.names])}")
    with PLUGINS.name_in_errors(name):
        return check_recording(read(request), partial(PLUGINS.guard, name))


def reads(*options: str) -> Callable[[Reader], Reader]:
    """Declare further fields of a `Request` that the function of a plugin's data set reads: `lidar`, `version`.

    `semcal import` then has these options for this data set. They are kept in `request_options` of the function.

    Raises:
        TypeError: there is no such option, or it is named twice.
    """
    if unknown := [option for option in options if option not in OWN_OPTIONS]:
        raise TypeError(f"reads: found {describe(unknown[0])}, expected {' or '.join(OWN_OPTIONS)}")
    if len({*options}) < len(options):
        raise TypeError(f"reads: found {listed(options)}, expected each once")

    def declare(read: Reader) -> Reader:
        read.request_options = options  # type: ignore[attr-defined]
        return read

    return declare
