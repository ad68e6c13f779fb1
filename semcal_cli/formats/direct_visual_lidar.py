"""direct_visual_lidar_calibration's calib.json: p_lidar = T p_camera, `results.T_lidar_camera` as x y z qx qy qz qw."""

from __future__ import annotations

from typing import Any

from semcal_cli.formats.format import Format, FormatOptions, Source, document_writer, from_quaternion, xyz
from semcal_cli.formats.values import at, numbers_in
from semcal_cli.geometry.poses import Pose, inverse, quaternion_xyzw

KEY = "T_lidar_camera"


def _read(source: Source, options: FormatOptions) -> Pose:
    where = f"{source.path}: results"
    x, y, z, *quaternion = numbers_in(where, at(str(source.path), source.document, "results"), KEY, 7)
    return inverse(from_quaternion(f"{where}.{KEY}", quaternion, [x, y, z], options))


def _put(document: Any, T_camera_lidar: Pose, options: FormatOptions) -> None:
    T = inverse(T_camera_lidar)
    document.setdefault("results", {})[KEY] = [*xyz(T), *quaternion_xyzw(T).tolist()]


def _recognises(source: Source) -> bool:
    results = source.mapping.get("results")
    return isinstance(results, dict) and KEY in results


FORMAT = Format(
    "direct-visual-lidar",
    f"p_lidar = T p_camera: results.{KEY} of calib.json, x y z qx qy qz qw",
    _recognises,
    _read,
    document_writer(_put, as_json=True),
    _put,
)
