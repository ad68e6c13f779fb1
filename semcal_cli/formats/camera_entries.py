"""Files with an entry for each camera, which holds p_camera = T p_lidar under a key, such as `lidar2cam`.

The infos of MMDetection3D and similar projects have it; Kalibr's camchain has a key of its own, and intrinsics.
"""

from __future__ import annotations

from typing import Any

from semcal_cli.errors import InputError, listed
from semcal_cli.formats.documents import entry_format
from semcal_cli.formats.format import Format, FormatOptions
from semcal_cli.formats.lenses import LensReader, SetLens
from semcal_cli.formats.node import Node
from semcal_cli.formats.pose import Matrix


def camera_format(
    name: str,
    equation: str,
    key: str,
    first_camera: str,
    *,
    as_json: bool = False,
    lens: LensReader | None = None,
    set_lens: SetLens | None = None,
) -> Format:
    """Make the format of files with an entry for each camera, which has the matrix under a key."""

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
        as_json=as_json,
        asks=("camera",),
        lens=lens,
        set_lens=set_lens,
    )


LIDAR2CAM = camera_format(
    "lidar2cam", "lidar2cam of a camera's entry, JSON", "lidar2cam", "CAM_FRONT", as_json=True
)
