"""Files with an entry for each camera, which holds p_camera = T p_lidar.

One is a Kalibr camchain with `T_cam_lidar`, named after Kalibr's `T_cam_imu`; the other has `lidar2cam`, as the infos
of MMDetection3D and similar projects do.
"""

from __future__ import annotations

from typing import Any

from semcal_cli.errors import InputError
from semcal_cli.files.messages import listed
from semcal_cli.formats.format import Format, FormatOptions, Source, document_writer, from_rows
from semcal_cli.formats.values import matrix_at, rows_like
from semcal_cli.geometry.poses import Pose


def _format(name: str, equation: str, key: str, first_camera: str, *, as_json: bool = False) -> Format:
    def cameras(document: Any) -> list[Any]:
        return [camera for camera, entry in document.items() if isinstance(entry, dict) and key in entry]

    def read(source: Source, options: FormatOptions) -> Pose:
        where, found = str(source.path), cameras(source.mapping)
        camera = options.camera or (found[0] if len(found) == 1 else None)
        if camera not in found:
            raise InputError(f"{where}: found {key} of {listed(found)}, needed --camera to name one of them")
        rows = matrix_at(f"{where}: {camera}", source.mapping[camera], key)
        return from_rows(f"{where}: {camera}.{key}", rows, options)

    def put(document: Any, T_camera_lidar: Pose, options: FormatOptions) -> None:
        # In a chain the cameras come before their poses.
        found = cameras(document) or [camera for camera in document if str(camera).startswith("cam")]
        if len(found) > 1 if options.camera is None else bool(found) and options.camera not in found:
            raise InputError(
                f"{options.file}: found cameras {listed(found)}, needed --to-camera to name one of them"
            )
        camera = options.camera or (found[0] if found else first_camera)
        entry = document.setdefault(camera, {})
        entry[key] = rows_like(entry.get(key), T_camera_lidar)

    return Format(
        name,
        f"p_camera = T p_lidar: {equation}",
        lambda source: bool(cameras(source.mapping)),
        read,
        document_writer(put, as_json=as_json),
        put,
        ("camera",),
    )


KALIBR = _format("kalibr", "T_cam_lidar of a camchain's camera", "T_cam_lidar", "cam0")
LIDAR2CAM = _format(
    "lidar2cam", "lidar2cam of a camera's entry, JSON", "lidar2cam", "CAM_FRONT", as_json=True
)
