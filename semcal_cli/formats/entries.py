"""Formats of documents with an entry that holds the pose of a camera and a LiDAR."""

from __future__ import annotations

import json
from typing import Any

from semcal_cli.errors import InputError, listed
from semcal_cli.formats.documents import SetLens, entry_format, under
from semcal_cli.formats.format import Format, FormatOptions, Source
from semcal_cli.formats.frames import CAMERA
from semcal_cli.formats.node import Node
from semcal_cli.formats.pose import PLACE, WXYZ, XYZW, Matrix, Numbers, checked, transform
from semcal_cli.geometry.poses import Pose

RELLIS_3D_KEY = "os1_cloud_node-pylon_camera_node"
"""Key of the LiDAR and camera; other files of the data set have the same layout but relate two LiDARs."""
# The file does not state its direction; labels and images agree only in this one.
RELLIS_3D = entry_format(
    "rellis-3d",
    f"p_lidar = T p_camera: transforms.yaml, {RELLIS_3D_KEY}",
    lambda source: RELLIS_3D_KEY in source.mapping,
    under(RELLIS_3D_KEY),
    Numbers({"q": WXYZ, "t": PLACE}, are_named=True),
    maps_camera=True,
)


def _has_results(source: Source) -> bool:
    results = source.mapping.get("results")
    return isinstance(results, dict) and "T_lidar_camera" in results


DIRECT_VISUAL_LIDAR = entry_format(
    "direct-visual-lidar",
    "p_lidar = T p_camera: results.T_lidar_camera of calib.json, x y z qx qy qz qw",
    _has_results,
    under("results"),
    Numbers({"T_lidar_camera": (*PLACE, *XYZW)}),
    maps_camera=True,
    as_json=True,
)


def camera_format(
    name: str, equation: str, key: str, first_camera: str, *, set_lens: SetLens | None = None, **others: Any
) -> Format:
    """Make the format of files with an entry for each camera, which has p_camera = T p_lidar under a key."""

    def cameras(document: dict[Any, Any]) -> list[Any]:
        return [camera for camera, entry in document.items() if isinstance(entry, dict) and key in entry]

    def find(document: Node, options: FormatOptions) -> Node:
        if options.is_written and not document.value:
            document.mapping[options.camera or first_camera] = {key: None}
        found = cameras(document.mapping)
        camera = options.camera or (found[0] if len(found) == 1 else None)
        if camera not in found:
            needed = f"needed {options.prefix}camera to name one of them"
            raise InputError(f"{document.where}: found {key} of {listed(found)}, {needed}")
        return document.at(camera)

    return entry_format(
        name,
        f"p_camera = T p_lidar: {equation}",
        lambda source: bool(cameras(source.mapping)),
        find,
        Matrix(key),
        asks=("camera",),
        set_lens=set_lens,
        **others,
    )


# The infos of MMDetection3D and similar projects.
LIDAR2CAM = camera_format(
    "lidar2cam", "lidar2cam of a camera's entry, JSON", "lidar2cam", "CAM_FRONT", as_json=True
)


def _blocks(node: Node) -> list[Node]:
    """All blocks with Rcl and Pcl, at any depth, as inside ROS 2's `/**: ros__parameters:`."""
    if not isinstance(node.value, dict):
        return []
    inner = [block for key, value in node.value.items() for block in _blocks(node.child(key, value))]
    return [node, *inner] if node.value.keys() >= {"Rcl", "Pcl"} else inner


def _find_block(document: Node, options: FormatOptions) -> Node:
    if options.is_written and not document.value:
        return under("extrin_calib")(document, options)
    blocks = _blocks(document)
    if len(blocks) != 1:
        raise InputError(f"{document.where}: found {len(blocks)} blocks with Rcl and Pcl, needed one")
    return blocks[0]


class _RotationAndPlace:
    """A pose as its rotation by rows, and its translation."""

    def read(self, node: Node, options: FormatOptions) -> Pose:
        R = node.at("Rcl")
        return checked(R.where, transform(R.matrix(3, 3), node.at("Pcl").numbers(3)), options)

    def put(self, entry: dict[Any, Any], T: Pose) -> None:
        entry["Rcl"], entry["Pcl"] = T[:3, :3].ravel().tolist(), T[:3, 3].tolist()


FAST_LIVO2 = entry_format(
    "fast-livo2",
    "p_camera = Rcl p_lidar + Pcl: extrin_calib",
    lambda source: bool(_blocks(Node("", source.mapping))),
    _find_block,
    _RotationAndPlace(),
)

ROTATION, TRANSLATION, NAME = "cam_from_rig_rotation", "cam_from_rig_translation", "image_prefix"
COLMAP_POSE = Numbers({ROTATION: WXYZ, TRANSLATION: PLACE})


def _rig_cameras(rigs: Node) -> list[Node]:
    """Cameras of all rigs that have a pose in their rig."""
    found = []
    for index, rig in enumerate(rigs.value if isinstance(rigs.value, list) else []):
        cameras = rig.get("cameras") if isinstance(rig, dict) else None
        for number, camera in enumerate(cameras if isinstance(cameras, list) else []):
            if isinstance(camera, dict) and ROTATION in camera:
                found.append(rigs.child(index, rig).child("cameras", cameras).child(number, camera))
    return found


def _find_rig_camera(document: Node, options: FormatOptions) -> Node:
    cameras = _rig_cameras(document)
    found = [camera for camera in cameras if options.camera in (None, camera.value.get(NAME))]
    if len(found) != 1:
        known = listed(camera.value.get(NAME) for camera in cameras)
        needed = f"needed {options.prefix}camera with the {NAME} of one of them"
        raise InputError(f"{document.where}: found cameras {known}, {needed}")
    return found[0]


def _make_rig(T_camera_lidar: Pose, options: FormatOptions) -> bytes:
    camera: dict[str, Any] = {NAME: options.camera or CAMERA}
    COLMAP_POSE.put(camera, T_camera_lidar)
    return (json.dumps([{"cameras": [camera]}], indent=2) + "\n").encode()


COLMAP = entry_format(
    "colmap",
    f"p_camera = T p_rig, the rig being the LiDAR: {ROTATION} (w x y z) and {TRANSLATION}",
    lambda source: bool(_rig_cameras(Node("", source.records))),
    _find_rig_camera,
    COLMAP_POSE,
    make=_make_rig,
    asks=("camera",),
)
