"""Frames of a file: which is the camera's and which the LiDAR's, by whole words of their names, and their axes.

Parts of words do not count: `pos_camera` contains `os`. A name with words of both sensors is ambiguous: `hesai_cam` is
a camera next to a Hesai LiDAR.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import replace

import numpy as np

from semcal_cli.drive.frame_ids import FrameIds
from semcal_cli.errors import ChoiceError, InputError, listed
from semcal_cli.formats.format import FormatOptions
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import OPTICAL_AXES, inverse

LIDAR, CAMERA, CAMERA_BODY = "lidar", "camera_optical_frame", "camera_link"
"""Default names of the frames."""
WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
"""A word: digits and punctuation separate words, and so do capitals, as in `frontCamera` and `RGBCamera`."""
OPTICAL_WORDS = {"optical"}
CAMERA_WORDS = {"cam", "cams", "camera", "cameras"} | OPTICAL_WORDS
LIDAR_WORDS = {"lidar", "lidars", "laser", "laserscan", "laserscanner", "scan", "scanner"} | {
    *("velodyne", "vlp", "hdl", "ouster", "os", "hesai", "pandar", "livox", "robosense", "rslidar")
}
"""Words of LiDAR frames. A frame with another name, such as `base_link`, is the LiDAR's only if the user says so."""
T_BODY_OPTICAL = np.eye(4)
T_BODY_OPTICAL[:3, :3] = OPTICAL_AXES


def has_word(name: str, words: set[str]) -> bool:
    """Return whether a name contains one of the words."""
    return bool(words & {word.lower() for word in WORD.findall(name.replace("LiDAR", "Lidar"))})


def camera_and_lidar(
    where: str, kind: str, names: Collection[str], options: FormatOptions, *, prefers_optical: bool = False
) -> tuple[str, str]:
    """Choose the camera and the LiDAR among the names of a file.

    These are the names that the user gives, those of the recording, or the only matching ones.

    Args:
        where: Name of the file in messages.
        kind: What the names stand for, such as `sensors`.
        names: All names in the file.
        options: The user's options.
        prefers_optical: Whether the only optical frame takes precedence over other camera frames.

    Raises:
        InputError: the file does not have a name that the user gives, or its names are ambiguous.
    """
    if len(set(names)) < 2:
        raise InputError(f"{where}: found {kind} {listed(names)}, expected two {kind}")
    options = with_recorded(options, names)
    cameras = [name for name in names if has_word(name, CAMERA_WORDS) and name != options.lidar]
    optical = [name for name in cameras if has_word(name, OPTICAL_WORDS)]
    if prefers_optical and len(optical) == 1:
        cameras = optical
    lidars = [name for name in names if has_word(name, LIDAR_WORDS) and name != options.camera]
    pair = []
    for side, name, candidates, other_words, needed in (
        ("camera", options.camera, cameras, LIDAR_WORDS, "one of them"),
        ("lidar", options.lidar, lidars, CAMERA_WORDS, "the LiDAR's own"),
    ):
        if name is None and len(candidates) == 1 and not has_word(candidates[0], other_words):
            name = candidates[0]
        if name is None or name not in names:
            raise ChoiceError(
                f"{where}: found {kind} {listed(names)}; add {options.option(side)} to name {needed}"
                f"{options.hint(side)}"
            )
        pair.append(name)
    camera, lidar = pair
    return camera, lidar


def with_recorded(options: FormatOptions, names: Collection[str]) -> FormatOptions:
    """Add the names of the recording for what the user does not name, where a file has them."""
    recorded, own = options.frame_ids or FrameIds(), (options.camera, options.lidar)
    camera, lidar = (
        name if name in names and name not in own else None for name in (recorded.camera, recorded.lidar)
    )
    return replace(options, camera=options.camera or camera, lidar=options.lidar or lidar)


def apply_direction(where: str, T: Pose, options: FormatOptions) -> Pose:
    """Apply the user's direction to a transform whose file does not state one: T_camera_lidar, or its inverse.

    Raises:
        InputError: the user does not state the direction either.
    """
    if options.direction is None:
        found = "found a transform without a stated direction"
        if options.is_written:  # whatever the file that is read states
            found = "this format may hold either direction"
        directions = "lidar-to-camera (p_camera = T p_lidar) or camera-to-lidar"
        first = ""
        if "direction" not in options.names:
            first = f"; first: `semcal convert {where} --direction lidar-to-camera --to semcal -o T.yaml`"
        raise InputError(f"{where}: {found}; add {options.option('direction')} {directions}{first}")
    return T if options.direction == "lidar-to-camera" else inverse(T)


def from_frames(where: str, T_parent_child: Pose, parent: str, child: str, options: FormatOptions) -> Pose:
    """Convert a transform between two named frames, p_parent = T p_child, to T_camera_lidar.

    Raises:
        InputError: neither the names nor the user's options determine which frame is the camera's, or its axes.
    """
    camera, _ = camera_and_lidar(where, "frames", (parent, child), options)
    T_lidar_camera = T_parent_child if camera == child else inverse(T_parent_child)
    return inverse(T_lidar_camera @ optical_axes(where, camera, options))


def between_frames(where: str, T_camera_lidar: Pose, parent: str, child: str, options: FormatOptions) -> Pose:
    """Convert T_camera_lidar to the transform between two named frames, p_parent = T p_child, as `from_frames` reads.

    Raises:
        InputError: neither the names nor the user's options determine which frame is the camera's, or its axes.
    """
    camera, _ = camera_and_lidar(where, "frames", (parent, child), options)
    T_lidar_camera = inverse(optical_axes(where, camera, options) @ T_camera_lidar)
    return T_lidar_camera if camera == child else inverse(T_lidar_camera)


def optical_axes(where: str, camera: str, options: FormatOptions) -> Pose:
    """Choose T_frame_optical (4, 4) of a camera frame, by its name, the recording or the user's option.

    Raises:
        InputError: none of them determines the axes.
    """
    is_recorded = options.frame_ids is not None and camera == options.frame_ids.camera
    is_optical = is_recorded or has_word(camera, OPTICAL_WORDS)
    frame = options.frame or ("optical" if is_optical else None)
    if frame is None:
        axes = "optical (x right, y down, z forward) or body (x forward, y left, z up)"
        needed = f"add {options.option('frame')} {axes}{options.hint('frame')}"
        raise InputError(f"{where}: found the camera frame {camera!r}; {needed}")
    return np.eye(4) if frame == "optical" else T_BODY_OPTICAL


def name_frames(T_camera_lidar: Pose, options: FormatOptions) -> tuple[Pose, str, str]:
    """Compute T_parent_frame (4, 4) of the camera frame to write, and name the parent frame and the camera frame.

    The parent is the frame of the LiDAR, or `options.base` if there is one.
    """
    base = None if options.base is None else options.base.name
    for name in filter(None, (options.lidar, options.camera, base)):
        try:
            FrameIds.check(name)
        except ValueError as error:
            names = ", ".join(map(options.option, ("camera", "lidar", "base_frame")))
            raise InputError(f"{names}: {error}") from None
    is_body, recorded = options.frame == "body", options.frame_ids or FrameIds()
    T = inverse(T_camera_lidar) @ (inverse(T_BODY_OPTICAL) if is_body else np.eye(4))
    parent, option = options.lidar or recorded.lidar or LIDAR, options.option("lidar")
    if options.base is not None:
        # T_base_camera = T_base_lidar T_lidar_camera
        T, parent, option = options.base.T_base_lidar @ T, options.base.name, options.option("base_frame")
    camera = options.camera or (CAMERA_BODY if is_body else recorded.camera or CAMERA)
    if camera == parent:
        raise InputError(
            f"{options.option('camera')}, {option}: found {camera!r} for both, expected two names"
        )
    return T, parent, camera
