"""Names of sensors: which of them are a camera's, and which a LiDAR's, by their whole words.

Parts of words say nothing: `pos_camera` holds `os`, and `hesai_cam` is a camera beside a LiDAR of Hesai's.
"""

from __future__ import annotations

import re
from collections.abc import Collection

from semcal_cli.errors import InputError
from semcal_cli.files.messages import listed

WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
"""A word: digits and signs separate words, and so do capitals, as in `frontCamera`, `RGBCamera` and `CAM_FRONT`."""
OPTICAL = {"optical"}
CAMERA = {"cam", "cams", "camera", "cameras"} | OPTICAL
LIDAR = {"lidar", "lidars", "laser", "laserscan", "laserscanner", "scan", "scanner"} | {
    *("velodyne", "vlp", "hdl", "ouster", "os", "hesai", "pandar", "livox", "robosense", "rslidar")
}
"""Words of LiDAR frames; a frame of another name, such as `base_link`, is the LiDAR's only if the user says so."""


def _words(name: str) -> set[str]:
    return {word.lower() for word in WORD.findall(name.replace("LiDAR", "Lidar"))}


def has_camera_word(name: str) -> bool:
    """Tell whether a name has a camera's word."""
    return bool(CAMERA & _words(name))


def has_lidar_word(name: str) -> bool:
    """Tell whether a name has a LiDAR's word."""
    return bool(LIDAR & _words(name))


def has_optical_word(name: str) -> bool:
    """Tell whether a name says that the axes are those of a camera's optical frame."""
    return bool(OPTICAL & _words(name))


def is_ambiguous(name: str) -> bool:
    """Tell whether a name may be a camera's as well as a LiDAR's."""
    return has_camera_word(name) and has_lidar_word(name)


def cameras_among(names: Collection[str], lidar: str | None) -> list[str]:
    """Find the names with a camera's word, except an ambiguous one that the user gives to the LiDAR."""
    return [name for name in names if has_camera_word(name) and not (name == lidar and is_ambiguous(name))]


def lidars_among(names: Collection[str], camera: str | None) -> list[str]:
    """Find the names with a LiDAR's word, except an ambiguous one that the user gives to the camera."""
    return [name for name in names if has_lidar_word(name) and not (name == camera and is_ambiguous(name))]


def choose(
    where: str, kind: str, names: Collection[str], found: list[str], wanted: str | None, option: str
) -> str:
    """Choose the name that the user wants, or the only one found by its words.

    Args:
        where: File in messages.
        kind: What the names name, as in `sensors`.
        names: All names of the file.
        found: Names with the right words.
        wanted: Name that the user gives.
        option: Option that gives it.

    Raises:
        InputError: the file does not have the name that the user wants, or the words of its names leave a choice.
    """
    if wanted is not None and wanted in names:
        return wanted
    if wanted is not None or len(found) != 1 or is_ambiguous(found[0]):
        raise InputError(f"{where}: found {kind} {listed(names)}, needed {option} to name one of them")
    return found[0]


def check_two(where: str, camera: str, lidar: str, needed: str) -> None:
    """Check that camera and LiDAR are not the same entry of a file.

    Raises:
        InputError: they are the same, so that the file has no transform from one sensor to the other.
    """
    if camera == lidar:
        raise InputError(f"{where}: found {camera!r} for both camera and LiDAR, needed {needed}")
