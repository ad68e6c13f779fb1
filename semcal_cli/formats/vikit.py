"""Intrinsics as FAST-LIVO2 has them for vikit: `cam_fx` and so on, or `fx` and so on under `camera`, at any depth.

`scale` shrinks the images that FAST-LIVO2 works with; K and the size are those of the images as they are recorded.
"""

from __future__ import annotations

from collections.abc import Iterator

from semcal_cli.errors import InputError
from semcal_cli.formats.format import CameraBlock, Source
from semcal_cli.formats.lenses import intrinsic_matrix, refuse_camera
from semcal_cli.formats.node import Node

PINHOLE = "Pinhole"
NAMES = ("model", "width", "height", "fx", "fy", "cx", "cy")
COEFFICIENTS = ("d0", "d1", "d2", "d3")
"""k1, k2, p1 and p2 of vikit's pinhole."""


def _cameras(node: Node, prefix: str = "cam_") -> Iterator[tuple[Node, str]]:
    """Find the mappings with a camera's numbers, each with the prefix of their names."""
    if not isinstance(node.value, dict):
        return
    if all(f"{prefix}{name}" in node.value for name in NAMES):
        yield node, prefix
    for key, value in node.value.items():
        yield from _cameras(node.child(key, value), "" if key == "camera" else "cam_")


def read_vikit_lens(source: Source, camera: str | None, model: str | None) -> CameraBlock | None:
    """Read the intrinsics of the only camera; None if the file has none of this form.

    Raises:
        InputError: there are several cameras, the lens is no pinhole, or a number is wrong.
    """
    cameras = list(_cameras(Node(str(source.path), source.mapping)))
    if not cameras:
        return None
    refuse_camera(source.path, camera)
    if len(cameras) > 1:
        raise InputError(f"{source.path}: found {len(cameras)} cameras, expected one")
    ((node, prefix),) = cameras

    def at(name: str) -> Node:
        return node.at(f"{prefix}{name}")

    if at("model").value != PINHOLE:
        raise at("model").mismatch(PINHOLE)
    has_coefficients = any(f"{prefix}{name}" in node.mapping for name in COEFFICIENTS)
    block = {
        "model": "plumb_bob",
        "width": at("width").side(),
        "height": at("height").side(),
        "K": intrinsic_matrix(*(at(name).number() for name in ("fx", "fy", "cx", "cy"))),
        "distortion": [at(name).number() for name in COEFFICIENTS] if has_coefficients else [],
    }
    return CameraBlock(block, {"K": f"{prefix}fx", "distortion": f"{prefix}d0"})
