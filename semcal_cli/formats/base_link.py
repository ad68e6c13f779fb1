"""The pose of a LiDAR on its vehicle, T_base_lidar: what `semcal base` writes, and files of other tools that hold it.

The frame of a vehicle, ROS's `base_link`, has x forward, y left and z up (REP 103). Files with named frames hold the
pose between two of them, as they hold that of a camera and a LiDAR: see `frame_names`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field

from semcal_cli.config.directions import BaseDirection
from semcal_cli.errors import InputError, listed
from semcal_cli.files.validation import (
    Count,
    RigidTransform,
    StrictModel,
    Vector3,
    Version,
    Width,
    validate,
)
from semcal_cli.formats import bases, matrix, ros, semcal, urdf
from semcal_cli.formats.format import Base, Format, FormatOptions, Source
from semcal_cli.formats.frame_names import LIDAR_WORDS, has_word
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse, mounting_rpy_deg

BASE_LINK = "base_link"
BASE = "semcal_base"
KNOWN = (
    ros.COMMAND,
    ros.LAUNCH,
    ros.LAUNCH_PY,
    ros.TF2,
    urdf.FORMAT,
    bases.AUTOWARE,
    matrix.TUM,
    matrix.TEXT,
    matrix.ARRAY,
)
"""Formats that may hold the pose of a LiDAR on its vehicle. Others only hold that of a camera."""
WRITTEN = (ros.COMMAND, ros.LAUNCH, ros.TF2, ros.APOLLO, urdf.FORMAT, bases.AUTOWARE)
"""Formats whose files name the frames of their transforms, one of which may be the vehicle's. A plugin's format knows
nothing of a base, and would write the transform from the LiDAR."""
AXES = ("forward", "backward"), ("left", "right"), ("up", "down")
TURNS = ("left of forward", "right of forward"), ("down", "up"), ("to the right", "to the left")
"""Words for positive and negative yaw, pitch and roll of a camera's body frame: see `pose_from_mounting`."""


Name: TypeAlias = Annotated[str, Field(min_length=1, max_length=200)]


class HalfWidths(StrictModel):
    """Half widths of 95 % intervals; None where the drive does not determine one."""

    roll_deg: Width | None = None
    """Half width of the interval of roll, degrees."""
    pitch_deg: Width | None = None
    """Half width of the interval of pitch, degrees."""
    yaw_deg: Width | None = None
    """Half width of the interval of yaw, degrees."""
    height_m: Width | None = None
    """Half width of the interval of the height above the ground, metres."""


class BaseDocument(StrictModel):
    """The pose of the LiDAR on its vehicle, as `semcal base` writes it."""

    semcal_base: Version = 1
    """Version of this format."""
    T_base_lidar: RigidTransform
    """p_base = T_base_lidar * p_lidar, metres. The base has x forward, y left, z up, and its origin on the ground."""
    base_frame: Name = BASE_LINK
    """Name of the vehicle's frame."""
    lidar_frame: Name | None = None
    """Name of the frame of the sweeps, where the drive has one."""
    rpy_deg: Vector3 | None = None
    """Roll, pitch and yaw of T_base_lidar, degrees: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    half_width_95: HalfWidths | None = None
    """How well the drive determines the pose."""
    yaw_from: Literal["motion", "option"] | None = None
    """Whether yaw is that of straight driving, or stated by the user."""
    num_frames: Count | None = None
    """Number of frames in which ground was found."""
    num_scenes: Count | None = None
    """Number of different scenes among them."""


def read_base(
    path: Path, *, direction: BaseDirection | None, name: str | None, written: FormatOptions
) -> Base:
    """Read the pose of a LiDAR on its vehicle.

    Args:
        path: Result of `semcal base`, or a file of a format of `KNOWN`.
        direction: Direction of a matrix whose file does not state it.
        name: Name of the vehicle's frame that the user gives.
        written: Options of the transform to write, with the names of the LiDAR's frame.

    Raises:
        InputError: the file is wrong, holds something else, leaves something open, or is about another LiDAR.
    """
    source = Source.read(path)
    recorded = None if written.frame_ids is None else written.frame_ids.lidar
    if BASE in source.mapping or source.mapping.keys() == {"T_base_lidar"}:
        _refuse_direction(path, direction, BASE, written)
        document = validate(BaseDocument, source.document, path)
        asked = written.lidar or recorded
        if document.lidar_frame is not None and asked not in (None, document.lidar_frame):
            raise InputError(
                f"{path}: lidar_frame: found {document.lidar_frame!r}, expected {asked!r}, the LiDAR of the "
                f"transform; if they are one LiDAR, add {written.option('lidar')} {document.lidar_frame}"
            )
        return Base(np.array(document.T_base_lidar), name or document.base_frame)
    candidates = [format for format in KNOWN if format.recognises(source)]
    if len(candidates) != 1:
        what = "a transform to a camera" if semcal.FORMAT.recognises(source) else "no known format"
        names = ", ".join(format.name for format in KNOWN)
        raise InputError(
            f"{path}: found {what}, expected the pose of the LiDAR on its vehicle: the result of `semcal base`, "
            f"T_base_lidar alone, or one of: {names}"
        )
    format = candidates[0]
    if format is bases.AUTOWARE:
        _refuse_direction(path, direction, format.name, written)
        return _read_kit(source, name, recorded, written)
    if "direction" in format.asks:
        if direction is None:
            choice = "lidar-to-base (p_base = T p_lidar) or base-to-lidar"
            raise InputError(
                f"{path}: found a transform without a stated direction; add {written.option('base_direction')} "
                f"{choice}"
            )
        T = format.read(source, FormatOptions("lidar-to-camera", names=written.names))
        return Base(T if direction == "lidar-to-base" else inverse(T), name or BASE_LINK)
    _refuse_direction(path, direction, format.name, written)
    return _read_frames(format, source, name or BASE_LINK, recorded, written)


def _refuse_direction(
    path: Path, direction: BaseDirection | None, format: str, written: FormatOptions
) -> None:
    if direction is not None:
        option = written.option("base_direction")
        raise InputError(
            f"{option}: found {direction!r}, but {path} states it itself ({format}); leave it out"
        )


def _read_frames(
    format: Format, source: Source, name: str, recorded: str | None, written: FormatOptions
) -> Base:
    """Read the pose between two named frames: that of the vehicle stands where a camera's optical frame would."""
    names = {**written.names, "camera": written.option("base_frame"), "lidar": written.option("lidar")}
    options = FormatOptions(camera=name, lidar=written.lidar, frame="optical", names=names)
    if written.lidar is None and recorded is not None and recorded in source.text:
        options = replace(options, lidar=recorded)
    try:
        return Base(format.read(source, options), name)
    except InputError as error:
        line = str(error).replace("between camera and LiDAR", f"between {name} and LiDAR")
        raise type(error)(line) from None


def _read_kit(source: Source, name: str | None, recorded: str | None, written: FormatOptions) -> Base:
    """Read the entry of the LiDAR in a file of Autoware, whose key is the name of the base."""
    kit = bases.kits_of(source.node)[0]
    base = next(str(key) for key, entry in source.mapping.items() if entry is kit.value)
    if name not in (None, base):
        option = written.option("base_frame")
        raise InputError(f"{option}: found {name!r}, expected {base!r}, the base in {source.path}")
    names = list(map(str, kit.mapping))
    asked = written.lidar or (recorded if recorded in names else None)
    lidars = [entry for entry in names if has_word(entry, LIDAR_WORDS)] if asked is None else [asked]
    if len(lidars) != 1 or lidars[0] not in names:
        raise InputError(
            f"{kit.where}: found sensors {listed(names)}; add {written.option('lidar')} to name the LiDAR's own"
        )
    return Base(bases.KIT_POSE.read(kit.at(lidars[0]), FormatOptions(names=written.names)), base)


def check_named(format: Format, options: FormatOptions) -> None:
    """Check that files of a format may hold the transform from a frame of the vehicle.

    Raises:
        InputError: they may not.
    """
    names = [written.name for written in WRITTEN]
    if format.name not in names:
        written = f"{options.option('to')} {format.name}"
        raise InputError(f"{written}: found {options.option('base')}, which needs one of: {', '.join(names)}")


def describe_pose(T_camera_lidar: Pose, base: Base, camera: str) -> str:
    """Describe in words where a camera is on its vehicle, and where it looks.

    Args:
        T_camera_lidar: (4, 4), metres.
        base: Pose of the LiDAR on the vehicle.
        camera: Name of the camera's frame.
    """
    T_base_camera = base.T_base_lidar @ inverse(T_camera_lidar)
    offsets = zip(T_base_camera[:3, 3].tolist(), AXES, strict=True)
    place = ", ".join(f"{abs(value):.3f} m {words[value < 0.0]}" for value, words in offsets)
    roll, pitch, yaw = mounting_rpy_deg(inverse(T_base_camera)).tolist()
    turns = zip((yaw, pitch, roll), TURNS, strict=True)
    aside, down, lean = (f"{abs(value):.1f} degrees {words[value < 0.0]}" for value, words in turns)
    return f"{base.name} to {camera}: {place}; the camera looks {aside} and {down}, and leans {lean}"
