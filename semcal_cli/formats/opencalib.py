"""OpenCalib's calib.txt (K, D, T): p_camera = T p_lidar, T as 3 x 4 by rows."""

from __future__ import annotations

from contextlib import suppress

from semcal_cli.errors import InputError
from semcal_cli.formats.format import Format, FormatOptions, Source, from_rows
from semcal_cli.formats.kitti import row
from semcal_cli.formats.values import keyed_lines, numbers
from semcal_cli.geometry.poses import Pose


def _read(source: Source, options: FormatOptions) -> Pose:
    values = numbers(source.path, keyed_lines(source.text), "T", 12)
    return from_rows(f"{source.path}: T", values, options)


def _write(T_camera_lidar: Pose, options: FormatOptions) -> bytes:
    return f"T: {row(T_camera_lidar)}\n".encode()


def _recognises(source: Source) -> bool:
    with suppress(InputError):
        keys = keyed_lines(source.text).keys()
        return "T" in keys and keys <= {"K", "D", "T"}
    return False


FORMAT = Format("opencalib", "p_camera = T p_lidar: T of calib.txt", _recognises, _read, _write)
