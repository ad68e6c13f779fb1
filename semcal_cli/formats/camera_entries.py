"""Files with an entry for each camera, which holds p_camera = T p_lidar.

One is a Kalibr camchain with `T_cam_lidar`, named after Kalibr's `T_cam_imu`, and with intrinsics; the other has
`lidar2cam`, as the infos of MMDetection3D and similar projects do.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from semcal_cli.drive.document import Camera
from semcal_cli.errors import InputError
from semcal_cli.files.messages import describe, listed
from semcal_cli.formats.format import Format, FormatOptions, Source, document_writer, from_rows
from semcal_cli.formats.lenses import kalibr_entry, with_count
from semcal_cli.formats.setting import check_size, tell
from semcal_cli.formats.values import matrix_at, rows_like
from semcal_cli.geometry.poses import Pose

SetLens: TypeAlias = Callable[[dict[str, Any], Camera, FormatOptions, bool], None]
"""Sets the intrinsics in the entry of a camera, which may be of a new file."""


def _format(
    name: str,
    equation: str,
    key: str,
    first_camera: str,
    set_lens: SetLens | None = None,
    *,
    as_json: bool = False,
) -> Format:
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
        is_new = not document
        # In a chain the cameras come before their poses.
        found = cameras(document) or [camera for camera in document if str(camera).startswith("cam")]
        if len(found) > 1 if options.camera is None else bool(found) and options.camera not in found:
            raise InputError(
                f"{options.file}: found cameras {listed(found)}, needed --to-camera to name one of them"
            )
        camera = options.camera or (found[0] if found else first_camera)
        entry = document.setdefault(camera, {})
        entry[key] = rows_like(entry.get(key), T_camera_lidar)
        if set_lens is not None and options.intrinsics is not None:
            set_lens(entry, options.intrinsics, options, is_new)

    return Format(
        name,
        f"p_camera = T p_lidar: {equation}",
        lambda source: bool(cameras(source.mapping)),
        read,
        document_writer(put, as_json=as_json),
        put,
        ("camera",),
    )


def _set_kalibr_lens(entry: dict[str, Any], camera: Camera, options: FormatOptions, is_new: bool) -> None:
    """Add the intrinsics to a new entry, or replace those that an entry has; one without any stays so."""
    if is_new:
        entry |= kalibr_entry("--to kalibr", camera)
        return
    if not {"camera_model", "intrinsics"} <= entry.keys():
        return
    sides, coefficients = entry.get("resolution"), entry.get("distortion_coeffs")
    check_size(options, camera, sides if isinstance(sides, list) else [sides])
    of_file = with_count(camera, len(coefficients) if isinstance(coefficients, list) else 0)
    found = kalibr_entry(str(options.file), of_file)
    for name in ("camera_model", "distortion_model"):
        if entry.get(name, found[name]) != found[name]:
            raise InputError(
                f"{options.file}: {name}: found {describe(entry[name])}, needed {found[name]!r}, as the camera "
                "that was estimated with the transform has it"
            )
    entry |= found
    tell(options, camera)


T_KALIBR = "T_cam_lidar"
KALIBR = _format("kalibr", "T_cam_lidar of a camchain's camera", T_KALIBR, "cam0", _set_kalibr_lens)
LIDAR2CAM = _format(
    "lidar2cam", "lidar2cam of a camera's entry, JSON", "lidar2cam", "CAM_FRONT", as_json=True
)
