"""Formats of YAML and JSON documents with one entry that holds the pose, or two entries with poses on one base."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from semcal_cli.drive.camera import Camera, CameraModel
from semcal_cli.errors import InputError, listed
from semcal_cli.formats.format import CameraBlock, Format, FormatOptions, Source
from semcal_cli.formats.lenses import intrinsic_matrix, refuse_camera
from semcal_cli.formats.node import Node
from semcal_cli.formats.pose import (
    WXYZ,
    XYZ,
    XYZW,
    MatrixNotation,
    NumbersNotation,
    PoseNotation,
    RotationNotation,
)
from semcal_cli.formats.vikit import read_vikit_lens
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse

Find: TypeAlias = Callable[[Node, FormatOptions], Node]
"""Finds the entry of a document that holds the pose, and adds it to a new document."""
MakeLens: TypeAlias = Callable[[str, Camera], dict[str, Any]]
"""Makes the keys of a camera's intrinsics; the text is the name of the file in messages."""


def under(*keys: str) -> Find:
    """Find the entry under nested keys."""

    def find(document: Node, options: FormatOptions) -> Node:
        for key in keys:
            if options.is_written:
                document.mapping.setdefault(key, {})
            document = document.at(key)
        return document

    return find


def entry_format(
    name: str,
    equation: str,
    recognises: Callable[[Source], bool],
    find: Find,
    notation: PoseNotation,
    *,
    maps_camera: bool = False,
    make_lens: MakeLens | None = None,
    **others: Any,
) -> Format:
    """Make a format of documents with one entry that holds T_camera_lidar or, if `maps_camera`, its inverse.

    `make_lens` makes the keys of the intrinsics in the same entry. `others` are fields of `Format`.
    """

    def read(source: Source, options: FormatOptions) -> Pose:
        T = notation.read(find(source.node, options), options)
        return inverse(T) if maps_camera else T

    def make(T_camera_lidar: Pose, options: FormatOptions) -> dict[str, Any]:
        document: dict[str, Any] = {}
        entry = find(Node(f"{options.option('to')} {name}", document), options).mapping
        notation.put(entry, inverse(T_camera_lidar) if maps_camera else T_camera_lidar)
        if make_lens is not None and options.intrinsics is not None:
            entry |= make_lens(f"{options.option('to')} {name}", options.intrinsics)
        return document

    return Format(name, equation, recognises, read, **{"make": make, **others})


class SensorPair(NamedTuple):
    """The entries of a camera and a LiDAR."""

    camera: Node
    lidar: Node
    T_frame_optical: Pose = np.eye(4)
    """(4, 4) maps the camera's optical frame to the frame of its entry."""


def base_format(
    name: str,
    equation: str,
    recognises: Callable[[Source], bool],
    find: Callable[[Node, FormatOptions], SensorPair],
    read_pose: Callable[[Node, FormatOptions], Pose],
    *,
    base: str,
    asks: tuple[str, ...],
    is_set: bool = False,
    make_on_base: Callable[[Pose, FormatOptions], dict[str, Any]] | None = None,
) -> Format:
    """Make a format of documents with the poses of sensors on a base, p_base = T p_sensor.

    The extrinsics alone do not determine the poses of camera and LiDAR on the base. `make_on_base` makes a file where
    the options have the base. If `is_set`, the pose of the camera can be set in a file; otherwise files are only read.
    """

    def read(source: Source, options: FormatOptions) -> Pose:
        pair = find(source.node, options)
        T_base_optical = read_pose(pair.camera, options) @ pair.T_frame_optical
        return inverse(T_base_optical) @ read_pose(pair.lidar, options)

    def make(T_camera_lidar: Pose, options: FormatOptions) -> dict[str, Any]:
        if options.base is not None and make_on_base is not None:
            return make_on_base(T_camera_lidar, options)
        add = (
            ""
            if make_on_base is None
            else f"add {options.option('base')} with the pose of the LiDAR on it, or "
        )
        needed = (
            f"{add}choose another format: the transform between two sensors does not determine these poses"
        )
        raise InputError(f"{options.option('to')} {name}: poses are relative to the {base}; {needed}")

    def set_camera(source: Source, T_camera_lidar: Pose, options: FormatOptions) -> tuple[Any, Pose]:
        if not is_set:
            raise InputError(
                f"{source.path}: found {name}, which is only read; choose another file for --into"
            )
        pair = find(source.node, options)
        T_base_optical = read_pose(pair.lidar, options) @ inverse(T_camera_lidar)
        return pair.camera.value, T_base_optical @ inverse(pair.T_frame_optical)

    return Format(name, equation, recognises, read, make, asks, set_camera=set_camera)


RELLIS_3D_KEY = "os1_cloud_node-pylon_camera_node"
"""Key of the pose of LiDAR and camera; other files of the data set have the same layout but relate two LiDARs."""
# The file does not state its direction; labels and images agree only in this direction.
RELLIS_3D = entry_format(
    "rellis-3d",
    f"p_lidar = T p_camera: transforms.yaml, {RELLIS_3D_KEY}",
    lambda source: RELLIS_3D_KEY in source.mapping,
    under(RELLIS_3D_KEY),
    NumbersNotation({"q": WXYZ, "t": XYZ}, are_named=True),
    maps_camera=True,
)


def _has_results(source: Source) -> bool:
    results = source.mapping.get("results")
    return isinstance(results, dict) and "T_lidar_camera" in results


DIRECT_LENSES: dict[str, CameraModel] = {"plumb_bob": "plumb_bob", "fisheye": "fisheye"}
"""Camera models of direct_visual_lidar_calibration whose parameters are fx fy cx cy (docs/programs.md)."""


def _read_direct_lens(source: Source, camera: str | None, model: str | None) -> CameraBlock | None:
    """Read `camera` of calib.json, which has no size of the images."""
    entry = Node(str(source.path), source.mapping).child("camera", source.mapping.get("camera"))
    if not isinstance(entry.value, dict) or not entry.value.keys() >= {"camera_model", "intrinsics"}:
        return None
    refuse_camera(source.path, camera)
    name = entry.at("camera_model")
    if str(name.value) not in DIRECT_LENSES:
        raise name.mismatch(f"one of: {', '.join(DIRECT_LENSES)}")
    block = {
        "model": DIRECT_LENSES[str(name.value)],
        "K": intrinsic_matrix(*entry.at("intrinsics").numbers(4)),
        "distortion": entry.mapping.get("distortion_coeffs") or [],
    }
    return CameraBlock(block, {"K": "camera.intrinsics", "distortion": "camera.distortion_coeffs"})


DIRECT_VISUAL_LIDAR = entry_format(
    "direct-visual-lidar",
    "p_lidar = T p_camera: results.T_lidar_camera of calib.json, x y z qx qy qz qw",
    _has_results,
    under("results"),
    NumbersNotation({"T_lidar_camera": (*XYZ, *XYZW)}),
    maps_camera=True,
    as_json=True,
    read_lens=_read_direct_lens,
)


def camera_format(
    name: str, equation: str, key: str, first_camera: str, *, make_lens: MakeLens | None = None, **others: Any
) -> Format:
    """Make a format of files with an entry for each camera, which holds p_camera = T p_lidar under a key."""

    def cameras(document: dict[Any, Any]) -> list[Any]:
        return [camera for camera, entry in document.items() if isinstance(entry, dict) and key in entry]

    def find(document: Node, options: FormatOptions) -> Node:
        if options.is_written:
            document.mapping[options.camera or first_camera] = {key: None}
        names = cameras(document.mapping)
        camera = options.camera or (names[0] if len(names) == 1 else None)
        if camera not in names:
            raise InputError(
                f"{document.where}: found {key} of {listed(names)}; add {options.option('camera')} to name one of them"
                f"{options.hint('camera')}"
            )
        return document.at(camera)

    return entry_format(
        name,
        f"p_camera = T p_lidar: {equation}",
        lambda source: bool(cameras(source.mapping)),
        find,
        MatrixNotation(key),
        asks=("camera",),
        make_lens=make_lens,
        **others,
    )


# The info files of MMDetection3D and similar projects.
LIDAR2CAM = camera_format(
    "lidar2cam", "lidar2cam of a camera's entry, JSON", "lidar2cam", "CAM_FRONT", as_json=True
)


def _blocks(node: Node) -> list[Node]:
    """List all blocks with Rcl and Pcl at any depth, for instance inside ROS 2's `/**: ros__parameters:`."""
    if not isinstance(node.value, dict):
        return []
    inner = [block for key, value in node.value.items() for block in _blocks(node.child(key, value))]
    return [node, *inner] if node.value.keys() >= {"Rcl", "Pcl"} else inner


def _find_block(document: Node, options: FormatOptions) -> Node:
    if options.is_written:
        return under("extrin_calib")(document, options)
    blocks = _blocks(document)
    if len(blocks) != 1:
        raise InputError(f"{document.where}: found {len(blocks)} blocks with Rcl and Pcl, expected one")
    return blocks[0]


FAST_LIVO2 = entry_format(
    "fast-livo2",
    "p_camera = Rcl p_lidar + Pcl: extrin_calib",
    lambda source: bool(_blocks(Node("", source.mapping))),
    _find_block,
    RotationNotation("Rcl", "Pcl"),
    read_lens=read_vikit_lens,
)
