"""Calibration files of KITTI, KITTI-360 and OpenCalib: lines of `key: values`, or just twelve numbers.

KITTI's `Tr` (odometry, calib.txt), or `Tr_velo_to_cam` with `R0_rect` (object): p_camera0 = [R0_rect] T p_velo. Camera
0 is the rectified one; the others are shifted along its x axis, by `P1` to `P3` (Geiger et al., *Vision meets robotics:
The KITTI dataset*, 2013, eqs. 3 to 8). In KITTI raw's calib_velo_to_cam.txt (`R` and `T`) and in KITTI-360's
calib_cam_to_velo.txt, camera 0 is the one before rectification.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from semcal_cli.errors import InputError, counted
from semcal_cli.files.input_files import read_text
from semcal_cli.files.output_files import descriptor
from semcal_cli.formats.format import Edits, Format, FormatOptions, Source
from semcal_cli.formats.node import Node, parse_numbers, rigid
from semcal_cli.formats.pose import from_line, from_rows, number_text, rotation, transform
from semcal_cli.geometry.arrays import Numbers, Pose
from semcal_cli.geometry.poses import inverse

CAMERAS = ("P0", "P1", "P2", "P3")
ODOMETRY_KEY, OBJECT_KEY, RECTIFICATION = "Tr", "Tr_velo_to_cam", "R0_rect"
RAW_CAMERAS, RAW_CAMERAS_FILE = ("image_00", "image_01", "image_02", "image_03"), "calib_cam_to_cam.txt"
KITTI_360_FILE, KITTI_360_KEY = "calib_cam_to_velo.txt", "camera 0 to LiDAR"


class _RepeatedKey:
    """The value of a key that is on several lines, which is ambiguous."""

    def __repr__(self) -> str:
        return "several lines"


def parse_keyed(path: Path, text: str) -> Node:
    """Read the lines of a file as a document: the numbers under each key, or text where not all are numbers."""
    values: dict[str, object] = {}
    for key, colon, line in (line.partition(":") for line in text.splitlines()):
        if colon:
            name = key.strip()
            values[name] = _RepeatedKey() if name in values else _numbers(line)
    return Node(str(path), values)


def read_keyed(path: Path) -> Node:
    """Read a file of `key: values` lines.

    Raises:
        InputError: the file is missing or is not text.
    """
    return parse_keyed(path, read_text(path))


def _numbers(line: str) -> list[float] | str:
    try:
        return [float(word) for word in line.split()]
    except ValueError:
        return line.strip()


def _keys(source: Source) -> set[str]:
    return set(parse_keyed(source.path, source.start).value)


def _row(values: Numbers) -> str:
    """Write numbers by rows on one line."""
    return " ".join(map(number_text, values.ravel().tolist()))


def offset_from_camera0(projection: Node) -> Pose:
    """Derive T_camera_camera0 (4, 4) of a rectified camera from its projection matrix.

    Raises:
        InputError: the matrix is wrong, K is singular, or the camera is too far away.
    """
    P = projection.matrix(3, 4)
    try:
        with np.errstate(all="ignore"):
            return rigid(projection.where, transform(np.eye(3), np.linalg.solve(P[:, :3], P[:, 3])))
    except np.linalg.LinAlgError:
        raise InputError(f"{projection.where}: found a singular K, expected an invertible one") from None


def camera0_pose(lines: Node, key: str, options: FormatOptions | None = None) -> Pose:
    """Read T_camera0_lidar (4, 4) of the rectified camera 0 from the lines of a file, under `Tr` or `Tr_velo_to_cam`.

    Raises:
        InputError: a number is missing or wrong, or a transform is not rigid.
    """
    T = from_line(lines.at(key), options)
    return T if key == ODOMETRY_KEY else rotation(lines.at(RECTIFICATION), options) @ T


def unrectified_camera0_pose(path: Path, text: str, options: FormatOptions | None = None) -> Pose:
    """Read T_camera0_lidar (4, 4) from the text of KITTI-360's calib_cam_to_velo.txt.

    Raises:
        InputError: the text is not a rigid transform of twelve numbers.
    """
    return inverse(
        from_rows(f"{path}: {KITTI_360_KEY}", parse_numbers(path, KITTI_360_KEY, text, 12), options)
    )


def raw_pose(
    velo: Node, cameras: Node | None, camera: str | None, options: FormatOptions | None = None
) -> Pose:
    """Read T_camera_lidar (4, 4) from the lines of calib_velo_to_cam.txt and calib_cam_to_cam.txt of KITTI raw.

    Args:
        velo: Lines of calib_velo_to_cam.txt, which maps the LiDAR to camera 0 before rectification.
        cameras: Lines of calib_cam_to_cam.txt, needed only for a rectified camera.
        camera: A rectified camera, such as `image_02`; None for camera 0 before rectification.
        options: Whether rotations are repaired.

    Raises:
        InputError: a number is missing or wrong, or a transform is not rigid.
    """
    shift = velo.at("T")
    T = rigid(shift.where, transform(np.eye(3), shift.numbers(3))) @ rotation(velo.at("R"), options)
    if camera is None or cameras is None:
        return T
    projection = cameras.at(f"P_rect_{camera.removeprefix('image_')}")
    return offset_from_camera0(projection) @ rotation(cameras.at("R_rect_00"), options) @ T


def _read_raw(source: Source, options: FormatOptions) -> Pose:
    cameras = None if options.camera is None else _raw_cameras(source, options.camera, options)
    return raw_pose(parse_keyed(source.path, source.text), cameras, options.camera, options)


def _raw_cameras(source: Source, camera: str, options: FormatOptions) -> Node:
    """Read the cameras next to calib_velo_to_cam.txt."""
    _check_camera(camera, RAW_CAMERAS, options)
    if descriptor(source.path) is not None:
        raise InputError(
            f"{source.path}: found a stream, expected a file with {RAW_CAMERAS_FILE} next to it for "
            f"{options.option('camera')}"
        )
    return read_keyed(source.path.with_name(RAW_CAMERAS_FILE))


def _make_raw(T_camera_lidar: Pose, options: FormatOptions) -> bytes:
    _check_no_camera(options)
    _note_camera0("kitti-raw", options)
    return f"R: {_row(T_camera_lidar[:3, :3])}\nT: {_row(T_camera_lidar[:3, 3])}\n".encode()


def _make_360(T_camera_lidar: Pose, options: FormatOptions) -> bytes:
    _note_camera0("kitti-360", options)
    return f"{_row(inverse(T_camera_lidar)[:3])}\n".encode()


def _note_camera0(name: str, options: FormatOptions) -> None:
    options.note(
        f"{options.option('to')} {name}: the transform is written as that of camera 0 before rectification"
    )


def _check_camera(camera: str, cameras: tuple[str, ...], options: FormatOptions) -> None:
    if camera not in cameras:
        raise InputError(
            f"{options.option('camera')}: found {camera!r}, expected one of: {', '.join(cameras)}"
        )


def _check_no_camera(options: FormatOptions) -> None:
    if options.camera is not None:
        needed = "expected no name: a new file has only camera 0"
        raise InputError(f"{options.option('camera')}: found {options.camera!r}, {needed}")


def _kitti(name: str, equation: str, key: str, first_line: str = "") -> Format:
    def read(source: Source, options: FormatOptions) -> Pose:
        lines = parse_keyed(source.path, source.text)
        T = camera0_pose(lines, key, options)
        if options.camera is None:
            if any(name in lines.mapping for name in CAMERAS[1:]):
                other = f"{options.option('camera')} P2 reads another"
                options.note(f"{source.path}: read as the transform of camera 0; {other}")
            return T
        _check_camera(options.camera, CAMERAS, options)
        return offset_from_camera0(lines.at(options.camera)) @ T

    def make(T_camera_lidar: Pose, options: FormatOptions) -> bytes:
        if options.camera != CAMERAS[0]:
            option = options.option("camera")
            found = "" if options.camera is None else f"found {option} {options.camera}; "
            needed = f"add {option} {CAMERAS[0]}, if the transform is that of the rectified camera 0"
            raise InputError(f"{options.option('to')} {name}: {found}{needed}")
        return f"{first_line}{key}: {_row(T_camera_lidar[:3])}\n".encode()

    def edit(source: Source, T_camera_lidar: Pose, _: str | None, options: FormatOptions) -> Edits:
        lines = parse_keyed(source.path, source.text)
        if options.camera not in CAMERAS:
            needed = f"add {options.option('camera')} with one of: {', '.join(CAMERAS)}"
            raise InputError(f"{source.path}: {needed}")
        T = inverse(offset_from_camera0(lines.at(options.camera))) @ T_camera_lidar
        if key == OBJECT_KEY:
            T = inverse(rotation(lines.at(RECTIFICATION))) @ T
        return _set_line(source, key, T[:3])

    equation = f"p_camera0 = {equation} p_velo; --camera P2 for another camera"
    return Format(
        name, equation, lambda source: key in _keys(source), read, make, asks=("camera",), edit=edit
    )


def _set_line(source: Source, key: str, values: Numbers) -> Edits:
    """Replace the numbers after a key, which must be on one line."""
    matches = list(re.finditer(rf"^[ \t]*{key}[ \t]*:[ \t]*([^\r\n]*)", source.text, re.MULTILINE))
    if len(matches) != 1:
        raise InputError(f"{source.path}: {key}: found {counted(len(matches), 'line')}, expected one")
    return [(*matches[0].span(1), _row(values))]


def _edit_raw(source: Source, T_camera_lidar: Pose, _: str | None, options: FormatOptions) -> Edits:
    T = T_camera_lidar
    if options.camera is None:
        _note_camera0("kitti-raw", options)
    else:
        zero = Node(str(source.path), {"R": np.eye(3).ravel().tolist(), "T": [0.0] * 3})
        T = inverse(raw_pose(zero, _raw_cameras(source, options.camera, options), options.camera)) @ T
    return _set_line(source, "R", T[:3, :3]) + _set_line(source, "T", T[:3, 3])


def _edit_opencalib(source: Source, T_camera_lidar: Pose, _: str | None, options: FormatOptions) -> Edits:
    return _set_line(source, "T", T_camera_lidar[:3])


ODOMETRY = _kitti("kitti-odometry", "Tr", ODOMETRY_KEY)
OBJECT = _kitti("kitti-object", "R0_rect Tr_velo_to_cam", OBJECT_KEY, f"{RECTIFICATION}: {_row(np.eye(3))}\n")
RAW = Format(
    "kitti-raw",
    "p_camera0 = T p_velo: calib_velo_to_cam.txt, camera 0 before rectification; --camera image_02 for a rectified "
    "one, with calib_cam_to_cam.txt next to it",
    lambda source: {"R", "T"} <= _keys(source) <= {"calib_time", "R", "T", "delta_f", "delta_c"},
    _read_raw,
    _make_raw,
    asks=("camera",),
    edit=_edit_raw,
)
KITTI_360 = Format(
    "kitti-360",
    "p_velo = T p_camera0: calib_cam_to_velo.txt, recognised by its name; camera 0 before rectification",
    lambda source: source.path.name == KITTI_360_FILE,
    lambda source, options: unrectified_camera0_pose(source.path, source.text, options),
    _make_360,
)
OPENCALIB = Format(
    "opencalib",
    "p_camera = T p_lidar: T of calib.txt",
    lambda source: {"T"} <= _keys(source) <= {"K", "D", "T"},
    lambda source, options: from_line(parse_keyed(source.path, source.text).at("T"), options),
    lambda T_camera_lidar, options: f"T: {_row(T_camera_lidar[:3])}\n".encode(),
    edit=_edit_opencalib,
)
