"""Transforms read from and written to files of any known format; an equation states the direction of each format."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from semcal_cli.config.directions import BaseDirection, Direction
from semcal_cli.drive.document import drive_file
from semcal_cli.errors import InputError, OccupiedError, describe, listed
from semcal_cli.files.documents import FORMATS as DOCUMENTS
from semcal_cli.files.input_files import is_same_file, read_bytes
from semcal_cli.files.output_files import descriptor, write_bytes
from semcal_cli.formats import base_link, bases, insertion, semcal
from semcal_cli.formats.format import Base, Format, FormatOptions, Source
from semcal_cli.formats.format_table import (
    FORMATS as FORMATS,
    all_formats as all_formats,
    find_format as find_format,
    plugin_formats as plugin_formats,
)
from semcal_cli.formats.frame_names import name_frames
from semcal_cli.formats.lenses import UnnamedLensError
from semcal_cli.formats.semcal import Extrinsic as Extrinsic
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import as_transform

REFERENCE_DIRECTION = "--reference-direction"
"""Option of commands that may read several transforms: it counts for files that do not state their direction."""
WITHOUT_OPTIONS = FormatOptions(names={})
"""What callers pass that take no options: messages then name those of `semcal convert`."""
NUMBERS = re.compile(rb"[-+0-9.eE]*[0-9][-+0-9.eE]*|\s+")
"""Numbers, and the spaces that align them."""


def read_extrinsic(
    path: Path | str,
    name: str | None = None,
    options: FormatOptions | None = None,
    *,
    ignores_unasked: bool = False,
) -> Extrinsic:
    """Read the transform of a file of any known format, or of a drive's folder, and what semcal wrote with it.

    The file is read once, because it may be standard input.

    Args:
        path: The file.
        name: Name of its format; None recognises it by its content.
        options: Options for what the file leaves open.
        ignores_unasked: Whether a direction or a camera counts only for a file that leaves it open, for callers that
            read several transforms with the same options; otherwise it is refused for other files.

    Raises:
        InputError: the content has no known format, has several formats, is wrong, or leaves something open.
    """
    path, options = Path(path), options or FormatOptions()
    source = Source.read(drive_file(path))
    try:
        format = _recognise(source, options) if name is None else find_format(name)
        if not format.recognises(source):
            _check_form(source)
        if ignores_unasked:
            options = replace(
                options,
                direction=options.direction if "direction" in format.asks else None,
                camera=options.camera if "camera" in format.asks else None,
            )
        _check_options(format, options)
        T_camera_lidar = format.read(source, options)
    except RecursionError:
        raise InputError(f"{path}: is nested too deeply, expected a transform") from None
    return Extrinsic(T_camera_lidar, source, format.asks)


def read_reference(
    path: Path | str,
    direction: Direction | None,
    camera: str | None = None,
    *,
    camera_option: str | None = None,
    on_note: Callable[[str], None] | None = None,
) -> Extrinsic:
    """Read a transform as `read_extrinsic` does, with options that count only for a file that leaves them open.

    Args:
        path: The file.
        direction: Direction of a matrix, by the option `REFERENCE_DIRECTION`.
        camera: Name of the camera in a file that may hold several.
        camera_option: Option by which the user can name it, if there is one.
        on_note: Called with what a reader should know, such as which of several cameras was read.

    Raises:
        InputError: see `read_extrinsic`.
    """
    names = {"direction": REFERENCE_DIRECTION} | ({} if camera_option is None else {"camera": camera_option})
    options = FormatOptions(direction, camera=camera, on_note=on_note, names=names)
    return read_extrinsic(path, None, options, ignores_unasked=True)


def read_transform(path: Path | str, name: str | None = None, options: FormatOptions | None = None) -> Pose:
    """Read the transform of a file of any known format, or of a drive's folder, as `read_extrinsic` does.

    Returns:
        T_camera_lidar (4, 4) float64, p_camera = T_camera_lidar @ p_lidar, metres.

    Raises:
        InputError: the content has no known format, has several formats, is wrong, or leaves something open.
    """
    return read_extrinsic(path, name, options).T_camera_lidar


def _recognise(source: Source, options: FormatOptions) -> Format:
    # A plugin changes nothing about files that semcal reads itself.
    recognised = [format for format in FORMATS if format.recognises(source)] or [
        format for format in plugin_formats() if format.recognises(source)
    ]
    candidates = [format for format in recognised if format.has_transform] or recognised
    if len(candidates) == 1:
        return candidates[0]
    if not candidates:
        _check_form(source)
    names = ", ".join(format.name for format in candidates or all_formats() if format.has_transform)
    if candidates:
        needed = f"add {options.option('from')} with one of: {names}{options.hint('from')}"
        raise InputError(f"{source.path}: found content of several formats; {needed}")
    # The list is long, and helps only where one of its names can be typed at once.
    is_typed = options.names.get("from") == "--from"
    known = f"of --from: {names}" if is_typed else "that `semcal convert --formats` lists"
    raise InputError(f"{source.path}: found {_content(source)}, expected a transform in a format {known}")


def _check_form(source: Source) -> None:
    """Raise the more helpful `InputError` of a malformed document if the suffix is that of a document."""
    if source.path.suffix.lower() in DOCUMENTS:
        _ = source.document


def _content(source: Source) -> str:
    """Describe the content of a file of an unknown format in a few words."""
    if source.mapping:
        return f"top-level keys {listed(map(describe, source.mapping))}"
    if not source.content.strip():
        return "nothing"
    first = source.content.splitlines()[0][:40].decode(errors="replace")
    return f"{describe(first)} and no known key"


def write_transform(
    T_camera_lidar: Pose, path: Path | str | None, name: str, options: FormatOptions | None = None
) -> bytes:
    """Write a transform in a format, to a file if a path is given, and return the content of the file.

    Raises:
        InputError: the transform is not rigid, the format is unknown or needs an option that is missing, or the file
            cannot be written.
    """
    T_camera_lidar = as_transform(T_camera_lidar, "T_camera_lidar")
    path = None if path is None else Path(path)
    format, options = find_format(name), replace(options or FormatOptions(), file=path, is_written=True)
    _check_options(format, options)
    try:
        content = format.write(T_camera_lidar, options)
    except UnnamedLensError as error:
        if not format.has_transform:
            raise
        # The transform matters more than the intrinsics.
        content = format.write(T_camera_lidar, replace(options, intrinsics=None))
        options.note(f"{error}: the transform is written without intrinsics")
    if path is not None:
        write_bytes(content, path)
    return content


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
    source, path = Path(source), None if output is None else Path(output)
    read_files = [drive_file(source)]
    if source.name == bases.TABLE:
        read_files.append(source.with_name(bases.SENSORS))
    if base is not None:
        base_link.check_named(find_format(to), write_options or FormatOptions())
        read_files.append(base)
    if path is not None and any(is_same_file(path, file) for file in read_files):
        raise InputError(f"{path}: found the input file; choose another name")
    written = write_options or FormatOptions()
    if find_format(to).has_transform:
        extrinsic = read_extrinsic(source, from_format, read_options)
        warnings = extrinsic.warnings
    else:
        _check_options(semcal.FORMAT, read_options or FormatOptions())
        content = Source.read(drive_file(source))
        if not semcal.FORMAT.recognises(content):
            _check_form(content)
        extrinsic, warnings = Extrinsic(np.eye(4), content, ()), []
        if extrinsic.camera is None or from_format not in (None, semcal.FORMAT.name):
            needed = f"a semcal calibration or a drive: {written.option('to')} {to} writes intrinsics"
            raise InputError(f"{source}: found no camera, expected {needed}")
    written = replace(
        written,
        intrinsics=extrinsic.camera,
        covariance=extrinsic.covariance,
        frame_ids=extrinsic.frame_ids,
    )
    if base is not None:
        written = replace(written, base=_read_base(base, base_direction, base_frame, written))
    if path is not None and path.is_file() and descriptor(path) is None and not replaces:
        made = write_transform(extrinsic.T_camera_lidar, None, to, replace(written, on_note=None))
        if _without_numbers(read_bytes(path)) != _without_numbers(made):
            raise OccupiedError(f"{path}: found a file that holds something else than a transform of {to}")
    for line in _notes_of_base(extrinsic.T_camera_lidar, written):
        written.note(line)
    text = write_transform(extrinsic.T_camera_lidar, path, to, written)
    for line in warnings:
        written.note(line)
    return text


def _read_base(path: Path, direction: BaseDirection | None, name: str | None, written: FormatOptions) -> Base:
    """Read the pose of the LiDAR of a transform on its vehicle."""
    return base_link.read_base(path, direction=direction, name=name, written=written)


def _notes_of_base(T_camera_lidar: Pose, written: FormatOptions) -> list[str]:
    """Describe where the camera is on its vehicle, if the transform is from there."""
    if written.base is None:
        return []
    _, _, camera = name_frames(T_camera_lidar, written)
    return [base_link.describe_pose(T_camera_lidar, written.base, camera)]


def _without_numbers(content: bytes) -> bytes:
    return NUMBERS.sub(b"0", content)


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
    path = None if output is None else Path(output)
    if path is not None and path.is_file() and not replaces:
        raise OccupiedError(f"{path}: found a file")
    extrinsic = read_extrinsic(source, from_format, read_options)
    read_files = [drive_file(Path(source)), *([] if base is None else [base])]
    if path is not None and any(is_same_file(path, file) for file in read_files):
        raise InputError(f"{path}: found the input file; choose another name")
    into = Source.read(Path(target))
    options = replace(write_options or FormatOptions(), frame_ids=extrinsic.frame_ids, is_written=True)
    format = insertion.format_of(into, key, FORMATS)
    if format is not None:
        _check_options(format, options)
    if base is None:
        content = insertion.set_transform(extrinsic.T_camera_lidar, into, format, key, options)
    else:
        options = replace(options, base=_read_base(base, base_direction, base_frame, options))
        content = insertion.set_on_base(extrinsic.T_camera_lidar, into, format, key, options)
    notes = [*_notes_of_base(extrinsic.T_camera_lidar, options), *extrinsic.warnings]
    if path is not None:
        write_bytes(content, path)
    for line in notes:
        options.note(line)
    return content


def _check_options(format: Format, options: FormatOptions) -> None:
    """Refuse options that the format does not use."""
    values = vars(options)
    for name in ("camera", "lidar"):
        if values[name] == "":
            raise InputError(f"{options.option(name)}: found nothing, expected a name")
    if options.camera is not None and options.camera == options.lidar:
        names = f"{options.option('camera')}, {options.option('lidar')}"
        raise InputError(f"{names}: found {options.camera!r} for both, expected two names")
    for name in ("direction", "frame", "camera", "lidar"):
        is_known = format is semcal.FORMAT and values[name] == "lidar-to-camera"  # what the file says, too
        if values[name] is not None and name not in format.asks and not is_known:
            raise InputError(
                f"{options.option(name)}: found {values[name]!r}, but {format.name} files state it themselves or have "
                "none; leave it out"
            )
