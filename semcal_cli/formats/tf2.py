"""tf2's TransformStamped as YAML, and Apollo's extrinsics, which have its layout: p_parent = T p_child.

`header.frame_id` is the parent. Apollo's child is a camera's optical frame (apollo, modules/drivers/camera/params).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from semcal_cli.formats.format import (
    FRAMES,
    Format,
    FormatOptions,
    Source,
    between,
    camera_frame,
    document_writer,
    from_quaternion,
    named,
    optical_axes,
    xyz,
)
from semcal_cli.formats.values import at, mapping_at, numbers_at, text_at
from semcal_cli.geometry.poses import Pose, inverse, quaternion_xyzw


def _read(source: Source, options: FormatOptions) -> Pose:
    document, where = mapping_at(str(source.path), source.document), str(source.path)
    transform = at(where, document, "transform")
    place = numbers_at(where, transform, "translation", ("x", "y", "z"))
    quaternion = numbers_at(where, transform, "rotation", ("x", "y", "z", "w"))
    parent = text_at(where, at(where, document, "header"), "frame_id")
    child = text_at(where, document, "child_frame_id")
    return between(where, from_quaternion(where, quaternion, place, options), parent, child, options)


def _read_apollo(source: Source, options: FormatOptions) -> Pose:
    document, where = mapping_at(str(source.path), source.document), str(source.path)
    camera = options.camera or text_at(where, document, "child_frame_id")
    return _read(source, replace(options, camera=camera, frame=options.frame or "optical"))


def _put(document: Any, T_camera_lidar: Pose, options: FormatOptions) -> None:
    if "child_frame_id" in document:
        # A file that names its frames keeps these names, and which of them is the camera's.
        where = str(options.file)
        parent = text_at(where, at(where, document, "header"), "frame_id")
        child = text_at(where, document, "child_frame_id")
        camera = camera_frame(where, parent, child, options, "--to-")
        T_lidar_frame = inverse(T_camera_lidar) @ inverse(optical_axes(where, camera, options, "--to-"))
        T = T_lidar_frame if camera == child else inverse(T_lidar_frame)
    else:
        T, lidar, camera = named(T_camera_lidar, options)
        document["header"], document["child_frame_id"] = {"frame_id": lidar}, camera
    x, y, z, w = quaternion_xyzw(T).tolist()
    transform = document.setdefault("transform", {})
    for name, keys, values in (("translation", "xyz", xyz(T)), ("rotation", "xyzw", [x, y, z, w])):
        transform.setdefault(name, {}).update(zip(keys, values, strict=True))


def _recognises(source: Source) -> bool:
    return {"header", "child_frame_id", "transform"} <= source.mapping.keys()


TF2 = Format(
    "tf2",
    "p_parent = T p_child: header.frame_id, child_frame_id, transform.translation, transform.rotation (x y z w)",
    _recognises,
    _read,
    document_writer(_put),
    _put,
    FRAMES,
)
APOLLO = Format(
    "apollo",
    "p_parent = T p_child as in tf2; the child is a camera's optical frame",
    lambda source: False,  # The layout is that of tf2, which reads it wherever the names tell the camera.
    _read_apollo,
    document_writer(_put),
    _put,
    FRAMES,
)
