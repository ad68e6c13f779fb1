"""A Kalibr camchain with `T_cam_lidar` in a camera's entry, as Kalibr has `T_cam_imu`: p_camera = T p_lidar."""

from __future__ import annotations

from typing import Any

from semcal_cli.documents import listed
from semcal_cli.errors import InputError
from semcal_cli.formats.format import Asked, Format, Source, document_writer, from_rows
from semcal_cli.formats.values import matrix_at
from semcal_cli.poses import Pose

KEY = "T_cam_lidar"


def _read(source: Source, asked: Asked) -> Pose:
    where = str(source.path)
    cameras = [name for name, entry in source.mapping.items() if isinstance(entry, dict) and KEY in entry]
    camera = asked.camera or (cameras[0] if len(cameras) == 1 else None)
    if camera not in cameras:
        raise InputError(f"{where}: found {KEY} of {listed(cameras)}, needed --camera to name one of them")
    return from_rows(
        f"{where}: {camera}.{KEY}", matrix_at(f"{where}: {camera}", source.mapping[camera], KEY), asked
    )


def _put(document: Any, T_camera_lidar: Pose, asked: Asked) -> None:
    cameras = [name for name in document if str(name).startswith("cam")]
    if asked.camera is None and len(cameras) > 1:
        raise InputError(f"--into: found cameras {listed(cameras)}, needed --camera to name one of them")
    camera = asked.camera or (cameras[0] if cameras else "cam0")
    document.setdefault(camera, {})[KEY] = T_camera_lidar.tolist()


FORMAT = Format(
    "kalibr",
    f"p_camera = T p_lidar: {KEY} of a camchain's camera",
    lambda source: any(isinstance(entry, dict) and KEY in entry for entry in source.mapping.values()),
    _read,
    document_writer(_put),
    _put,
)
