"""Transforms read from and written to files of any known format."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from semcal_cli.config.data_suffixes import kind_of_data
from semcal_cli.config.directions import Direction
from semcal_cli.drive.document import drive_file
from semcal_cli.errors import InputError, describe, listed
from semcal_cli.files.documents import FORMATS as DOCUMENTS
from semcal_cli.files.output_files import write_bytes
from semcal_cli.formats import semcal
from semcal_cli.formats.format import Format, FormatOptions, Source
from semcal_cli.formats.format_table import FORMATS, all_formats, find_format, plugin_formats
from semcal_cli.formats.lenses import UnnamedLensError
from semcal_cli.formats.semcal import Extrinsic
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import as_transform

REFERENCE_DIRECTION = "--reference-direction"
"""Option of commands that may read several transforms: it counts for files that do not state their direction."""
WITHOUT_OPTIONS = FormatOptions(names={})
"""What callers pass that take no options: messages then name those of `semcal convert`."""


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
        ignores_unasked: Whether a direction, a frame or a camera counts only for a file that leaves it open, for
            callers that read several transforms with the same options; otherwise it is refused for other files.

    Raises:
        InputError: the content has no known format, has several formats, is wrong, or leaves something open.
    """
    path, options = Path(path), options or FormatOptions()
    source = Source.read(drive_file(path))
    try:
        format = _recognise(source, options) if name is None else find_format(name)
        if not format.recognises(source):
            check_form(source)
        if ignores_unasked:
            options = replace(
                options,
                direction=options.direction if "direction" in format.asks else None,
                frame=options.frame if "frame" in format.asks else None,
                camera=options.camera if "camera" in format.asks else None,
            )
        check_options(format, options)
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
    check_options(format, options)
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


def check_options(format: Format, options: FormatOptions) -> None:
    """Refuse options that a format does not use.

    Raises:
        InputError: an option is stated that files of the format state themselves or do not have, or a name is empty or
            given twice.
    """
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


def check_form(source: Source) -> None:
    """Check that a file of an unknown format is well-formed, if its suffix is that of a document.

    Raises:
        InputError: it is not, which says more than that its format is unknown.
    """
    if source.path.suffix.lower() in DOCUMENTS:
        _ = source.document


def _recognise(source: Source, options: FormatOptions) -> Format:
    # A plugin changes nothing about files that semcal reads itself.
    recognised = [format for format in FORMATS if format.recognises(source)] or [
        format for format in plugin_formats() if format.recognises(source)
    ]
    candidates = [format for format in recognised if format.has_transform] or recognised
    if len(candidates) == 1:
        return candidates[0]
    if not candidates:
        check_form(source)
    names = ", ".join(format.name for format in candidates or all_formats() if format.has_transform)
    if candidates:
        needed = f"add {options.option('from')} with one of: {names}{options.hint('from')}"
        raise InputError(f"{source.path}: found content of several formats; {needed}")
    # The list is long, and helps only where one of its names can be typed at once.
    is_typed = options.names.get("from") == "--from"
    known = f"of --from: {names}" if is_typed else "that `semcal convert --formats` lists"
    raise InputError(f"{source.path}: found {_content(source)}, expected a transform in a format {known}")


def _content(source: Source) -> str:
    """Describe the content of a file of an unknown format in a few words."""
    if source.mapping:
        return f"top-level keys {listed(map(describe, source.mapping))}"
    if not source.content.strip():
        return "nothing"
    if (kind := kind_of_data(source.path)) is not None:
        return kind
    first = source.content.splitlines()[0][:40].decode(errors="replace")
    return f"{describe(first)} and no known key"
