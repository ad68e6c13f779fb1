"""tf2's TransformStamped as YAML, and Apollo's extrinsics, which have its layout: p_parent = T p_child.

`header.frame_id` is the parent. Apollo's child is a camera's optical frame (apollo, modules/drivers/camera/params).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from semcal_cli.formats.documents import under
from semcal_cli.formats.format import FRAMES, Format, FormatOptions, Source, document_writer
from semcal_cli.formats.frames import between, camera_frame, named, optical_axes
from semcal_cli.formats.node import Node
from semcal_cli.formats.pose import PLACE, XYZW, Numbers
from semcal_cli.geometry.poses import Pose, inverse

POSE = Numbers({"translation": PLACE, "rotation": XYZW}, are_named=True)


def _frames(document: Node) -> tuple[str, str]:
    """Parent and child."""
    return document.at("header").at("frame_id").text(), document.at("child_frame_id").text()


def _read(source: Source, options: FormatOptions) -> Pose:
    document = Node(str(source.path), source.document)
    T_parent_child = POSE.read(document.at("transform"), options)
    return between(document.where, T_parent_child, *_frames(document), options)


def _read_apollo(source: Source, options: FormatOptions) -> Pose:
    _, child = _frames(Node(str(source.path), source.document))
    frame = options.frame or "optical"
    return _read(source, replace(options, camera=options.camera or child, frame=frame))


def _put(document: Any, T_camera_lidar: Pose, options: FormatOptions) -> None:
    if "child_frame_id" in document:
        # A file that names its frames keeps these names, and which of them is the camera's.
        parent, child = _frames(Node(str(options.file), document))
        camera = camera_frame(str(options.file), parent, child, options)
        axes = optical_axes(str(options.file), camera, options)
        T_lidar_frame = inverse(T_camera_lidar) @ inverse(axes)
        T = T_lidar_frame if camera == child else inverse(T_lidar_frame)
    else:
        T, lidar, camera = named(T_camera_lidar, options)
        document["header"], document["child_frame_id"] = {"frame_id": lidar}, camera
    POSE.put(under("transform")(Node(str(options.file), document), options).mapping, T)


TF2 = Format(
    "tf2",
    "p_parent = T p_child: header.frame_id, child_frame_id, transform.translation, transform.rotation (x y z w)",
    lambda source: {"header", "child_frame_id", "transform"} <= source.mapping.keys(),
    _read,
    document_writer(_put),
    _put,
    FRAMES,
)
APOLLO = replace(
    TF2,
    name="apollo",
    equation="p_parent = T p_child as in tf2; the child is a camera's optical frame",
    # The layout is that of tf2, which reads it wherever the names tell the camera.
    recognises=lambda source: False,
    read=_read_apollo,
)
