"""OpenCalib's JSON (PJLab-ADG/SensorsCalibration): `A-to-B-extrinsic`, p_B = T p_A, and `camera-intrinsic`."""

from __future__ import annotations

from typing import Any

from semcal_cli.errors import InputError, counted
from semcal_cli.formats.format import FRAMES, CameraBlock, Format, FormatOptions, Source
from semcal_cli.formats.frame_names import camera_and_lidar
from semcal_cli.formats.lenses import model_by_count, refuse_camera
from semcal_cli.formats.node import Node
from semcal_cli.formats.pose import from_rows
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse

EXTRINSIC, INTRINSIC = "extrinsic", "intrinsic"


def _entries(document: Node, kind: str) -> list[Node]:
    """List the entries of a kind."""
    return [
        document.child(key, entry)
        for key, entry in (document.value.items() if isinstance(document.value, dict) else ())
        if isinstance(entry, dict) and entry.get("param_type") == kind
    ]


def _rows(matrix: Node) -> list[float]:
    """List the numbers of a matrix by rows."""
    return [number for row in matrix.at("data").rows() for number in row]


def _read(source: Source, options: FormatOptions) -> Pose:
    entries = _entries(source.node, EXTRINSIC)
    if len(entries) != 1:
        raise InputError(f"{source.path}: found {counted(len(entries), EXTRINSIC)}, expected one")
    (entry,) = entries
    names = entry.at("sensor_name").text(), entry.at("target_sensor_name").text()
    camera, _ = camera_and_lidar(str(source.path), "sensors", names, options)
    matrix = entry.at("param").at("sensor_calib")
    values = _rows(matrix)
    if len(values) != 16:
        raise InputError(f"{matrix.where}: found {counted(len(values), 'number')}, needed 4 rows of 4")
    T_target_sensor = from_rows(matrix.where, values, options)
    return T_target_sensor if camera == names[1] else inverse(T_target_sensor)


def _read_lens(source: Source, camera: str | None, model: str | None) -> CameraBlock | None:
    entries = _entries(Node(str(source.path), source.mapping), INTRINSIC)
    if not entries:
        return None
    if len(entries) != 1:
        raise InputError(f"{source.path}: found {counted(len(entries), INTRINSIC)}, expected one")
    refuse_camera(source.path, camera)
    parameters = entries[0].at("param")
    K, distortion = _rows(parameters.at("cam_K")), _rows(parameters.at("cam_dist"))
    if len(K) != 9:
        raise InputError(
            f"{parameters.at('cam_K').where}: found {counted(len(K), 'number')}, needed 9 by rows"
        )
    block: dict[str, Any] = {
        "model": model or model_by_count(parameters.at("cam_dist"), len(distortion)),
        "width": parameters.at("img_dist_w").side(),
        "height": parameters.at("img_dist_h").side(),
        "K": [K[:3], K[3:6], K[6:]],
        "distortion": distortion,
    }
    return CameraBlock(block, {"K": "cam_K", "distortion": "cam_dist"})


FORMAT = Format(
    "opencalib-json",
    "p_target = T p_sensor: param.sensor_calib of an extrinsic, which names target_sensor_name and sensor_name",
    lambda source: len(_entries(Node("", source.mapping), EXTRINSIC)) == 1,
    _read,
    asks=FRAMES[1:],
    read_lens=_read_lens,
)
