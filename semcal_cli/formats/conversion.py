"""Transforms converted from one file to another: to a new file of a format, or into a copy of a file."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from semcal_cli.config.directions import BaseDirection
from semcal_cli.drive.document import drive_file
from semcal_cli.errors import InputError, OccupiedError
from semcal_cli.files.input_files import is_same_file, read_bytes
from semcal_cli.files.output_files import descriptor, write_bytes
from semcal_cli.formats import base_link, bases, insertion, semcal
from semcal_cli.formats.format import FormatOptions, Source
from semcal_cli.formats.format_table import FORMATS, find_format
from semcal_cli.formats.frame_names import name_frames
from semcal_cli.formats.semcal import Extrinsic
from semcal_cli.formats.transform_files import check_form, check_options, read_extrinsic, write_transform
from semcal_cli.geometry.arrays import Pose

NUMBERS = re.compile(rb"[-+0-9.eE]*[0-9][-+0-9.eE]*|\s+")
"""Numbers, and the spaces that align them."""


def convert(
    source: Path | str,
    to: str,
    output: Path | str | None = None,
    *,
    replaces: bool = True,
    from_format: str | None = None,
    read_options: FormatOptions | None = None,
    write_options: FormatOptions | None = None,
    base: Path | None = None,
    base_direction: BaseDirection | None = None,
    base_frame: str | None = None,
) -> bytes:
    """Convert the transform of a file to another format, with the camera's intrinsics if that format holds them.

    Args:
        source: A file of any known format, or a drive with a reference. Calibrations and drives also have a camera.
        to: Name of the format to write: see `semcal convert --formats`.
        output: File to write; None writes no file.
        replaces: Whether `output` may be a file that holds more or less than what is written, such as a whole robot.
        from_format: Name of the source's format; None recognises it by its content.
        read_options: Options for what the source leaves open, such as its direction.
        write_options: Options for what the written format leaves open.
        base: File with the pose of the LiDAR on its vehicle, T_base_lidar. The transform is then written from the frame
            of the vehicle to the camera, and described in a note; None writes that from the LiDAR.
        base_direction: Direction of a matrix in `base` whose file does not state it.
        base_frame: Name of the vehicle's frame; None is the name in `base`, or `base_link`.

    Returns:
        The content of the file.

    Raises:
        InputError: a format is unknown, the source is wrong or leaves something open, or the file cannot be written.
    """
    source, path, written = Path(source), _path(output), write_options or FormatOptions()
    if base is not None:
        base_link.check_named(find_format(to), written)
    _check_output(path, source, base)
    has_transform = find_format(to).has_transform
    read = read_extrinsic if has_transform else _read_intrinsics
    extrinsic = read(source, from_format, read_options)
    if not has_transform and (extrinsic.camera is None or from_format not in (None, semcal.FORMAT.name)):
        needed = f"a semcal calibration or a drive: {written.option('to')} {to} writes intrinsics"
        raise InputError(f"{source}: found no camera, expected {needed}")
    written = replace(
        written,
        intrinsics=extrinsic.camera,
        covariance=extrinsic.covariance,
        frame_ids=extrinsic.frame_ids,
    )
    if base is not None:
        pose = base_link.read_base(base, direction=base_direction, name=base_frame, written=written)
        written = replace(written, base=pose)
    if not replaces:
        _check_replaced(path, extrinsic.T_camera_lidar, to, written)
    _note_all(written, _notes_of_base(extrinsic.T_camera_lidar, written))
    content = write_transform(extrinsic.T_camera_lidar, path, to, written)
    if has_transform:
        _note_all(written, extrinsic.warnings)
    return content


def set_in_file(
    source: Path | str,
    target: Path | str,
    output: Path | str | None = None,
    *,
    key: str | None = None,
    replaces: bool = False,
    from_format: str | None = None,
    read_options: FormatOptions | None = None,
    write_options: FormatOptions | None = None,
    base: Path | None = None,
    base_direction: BaseDirection | None = None,
    base_frame: str | None = None,
) -> bytes:
    """Set the transform of a file in a copy of another file, whose comments and layout stay: see `insertion`.

    Args:
        source: A file of any known format, or a drive with a reference.
        target: File to copy: a YAML or JSON document, a URDF, a launch file, or a calibration of KITTI or OpenCalib.
        output: File to write; None writes no file.
        key: Keys that lead to the transform in a document, or the name of a URDF's joint.
        replaces: Whether `output` may be a file that is there already, such as `target` itself.
        from_format: Name of the source's format; None recognises it by its content.
        read_options: Options for what the source leaves open.
        write_options: Options for what the target leaves open.
        base: File with the pose of the LiDAR on its vehicle: see `convert`.
        base_direction: Direction of a matrix in `base` whose file does not state it.
        base_frame: Name of the vehicle's frame; None is the name in `base`, or `base_link`.

    Returns:
        The content of the new file.

    Raises:
        InputError: a file is wrong or leaves something open, or the output is there already or cannot be written.
    """
    path = _path(output)
    if path is not None and path.is_file() and not replaces:
        raise OccupiedError(f"{path}: found a file")
    extrinsic = read_extrinsic(source, from_format, read_options)
    _check_output(path, Path(source), base)
    into = Source.read(Path(target))
    options = replace(write_options or FormatOptions(), frame_ids=extrinsic.frame_ids, is_written=True)
    format = insertion.format_of(into, key, FORMATS)
    if format is not None:
        check_options(format, options)
    if base is not None:
        pose = base_link.read_base(base, direction=base_direction, name=base_frame, written=options)
        options = replace(options, base=pose)
    insert = insertion.set_transform if base is None else insertion.set_on_base
    content = insert(extrinsic.T_camera_lidar, into, format, key, options)
    notes = [*_notes_of_base(extrinsic.T_camera_lidar, options), *extrinsic.warnings]
    if path is not None:
        write_bytes(content, path)
    _note_all(options, notes)
    return content


def _path(output: Path | str | None) -> Path | None:
    return None if output is None else Path(output)


def _check_output(path: Path | None, source: Path, base: Path | None) -> None:
    """Check that no input is replaced by the output."""
    read_files = [drive_file(source), *([] if base is None else [base])]
    if source.name == bases.TABLE:
        read_files.append(source.with_name(bases.SENSORS))
    if path is not None and any(is_same_file(path, file) for file in read_files):
        raise InputError(f"{path}: found the input file; choose another name")


def _read_intrinsics(source: Path, _: str | None, options: FormatOptions | None) -> Extrinsic:
    """Read a calibration or a drive for its camera alone: a drive need not have a reference."""
    check_options(semcal.FORMAT, options or FormatOptions())
    content = Source.read(drive_file(source))
    if not semcal.FORMAT.recognises(content):
        check_form(content)
    return Extrinsic(np.eye(4), content, ())


def _check_replaced(path: Path | None, T_camera_lidar: Pose, to: str, written: FormatOptions) -> None:
    """Check that an output that is there differs from what is written in its numbers alone."""
    if path is None or not path.is_file() or descriptor(path) is not None:
        return
    made = write_transform(T_camera_lidar, None, to, replace(written, on_note=None))
    if _without_numbers(read_bytes(path)) != _without_numbers(made):
        raise OccupiedError(f"{path}: found a file that holds something else than a transform of {to}")


def _without_numbers(content: bytes) -> bytes:
    return NUMBERS.sub(b"0", content)


def _notes_of_base(T_camera_lidar: Pose, written: FormatOptions) -> list[str]:
    """Describe where the camera is on its vehicle, if the transform is from there."""
    if written.base is None:
        return []
    _, _, camera = name_frames(T_camera_lidar, written)
    return [base_link.describe_pose(T_camera_lidar, written.base, camera)]


def _note_all(options: FormatOptions, lines: list[str]) -> None:
    for line in lines:
        options.note(line)
