"""Kalibr camchains (github.com/ethz-asl/kalibr/wiki/yaml-formats), with `T_cam_lidar` named after their `T_cam_imu`."""

from __future__ import annotations

from typing import Any

from semcal_cli.drive.camera import CAMERA_MODELS, Camera, CameraModel
from semcal_cli.formats.document_formats import camera_format
from semcal_cli.formats.format import CameraBlock, Source
from semcal_cli.formats.lenses import (
    UnnamedLensError,
    check_lens,
    coefficients_of,
    intrinsic_matrix,
    pixels_of,
)
from semcal_cli.formats.node import Node, pick

LENSES: dict[str, dict[str, CameraModel]] = {
    "pinhole": {"radtan": "plumb_bob", "equidistant": "fisheye", "fov": "fov", "none": "plumb_bob"},
    "omni": {"radtan": "omnidirectional", "none": "omnidirectional"},
    "ds": {"none": "double_sphere"},
}
"""Camera model of each camera_model and distortion_model. `intrinsics` begins with the parameters of the model."""
MODELS: dict[CameraModel, tuple[str, str]] = {
    "plumb_bob": ("pinhole", "radtan"),
    "fisheye": ("pinhole", "equidistant"),
    "omnidirectional": ("omni", "radtan"),
    "double_sphere": ("ds", "none"),
    "fov": ("pinhole", "fov"),
}
"""camera_model and distortion_model of each camera model."""
KEYS = {"K": "intrinsics", "distortion": "distortion_coeffs", "parameters": "intrinsics"}


def _read_lens(source: Source, camera: str | None, model: str | None) -> CameraBlock | None:
    chain = {
        str(key): entry
        for key, entry in source.mapping.items()
        # direct_visual_lidar_calibration has a camera_model, too, and none of these.
        if isinstance(entry, dict)
        and "camera_model" in entry
        and entry.keys() & {"resolution", "distortion_model"}
    }
    if not chain:
        return None
    entry = Node(str(source.path), chain[pick("camera", camera, list(chain), source.path)])
    kind = _check_name(entry.at("camera_model"), LENSES)
    lens = "none" if kind == "ds" else _check_name(entry.at("distortion_model"), LENSES[kind])
    camera_model = LENSES[kind][lens]
    width, height = (entry.child("resolution", side).side() for side in entry.at("resolution").numbers(2))
    parameters = tuple(CAMERA_MODELS[camera_model].parameters)
    intrinsics = entry.at("intrinsics").numbers(len(parameters) + 4)
    block: dict[str, Any] = {"width": width, "height": height, "model": camera_model}
    block["K"] = intrinsic_matrix(*intrinsics[len(parameters) :])
    if lens != "none":
        block["distortion"] = entry.at("distortion_coeffs").value
    elif kind != "ds":
        block["distortion"] = entry.mapping.get("distortion_coeffs", [])
    if parameters:
        block["parameters"] = dict(zip(parameters, intrinsics, strict=False))
    return CameraBlock(block, KEYS)


def _check_name(name: Node, names: dict[str, Any]) -> str:
    if str(name.value) not in names:
        raise name.mismatch(f"one of: {', '.join(names)}")
    return str(name.value)


def _make_lens(where: str, camera: Camera) -> dict[str, Any]:
    """Make the keys of a camera's intrinsics.

    Raises:
        UnnamedLensError: Kalibr has no name for the lens, or K or the lens has more numbers than Kalibr's.
    """
    check_lens(where, camera, MODELS)
    kind, lens = MODELS[camera.model]
    distortion = coefficients_of(camera) if camera.model == "fisheye" else list(camera.distortion)
    if camera.model == "plumb_bob":
        if any(distortion[4:]):
            needed = "needed 0: Kalibr's radtan has k1, k2, p1 and p2"
            raise UnnamedLensError(f"{where}: found the lens plumb_bob with k3 {distortion[4]}, {needed}")
        distortion = distortion[:4]
    return {
        "camera_model": kind,
        "distortion_coeffs": distortion,
        "distortion_model": lens if distortion else "none",
        "intrinsics": [
            *(camera.parameters[name] for name in CAMERA_MODELS[camera.model].parameters),
            *pixels_of(where, camera),
        ],
        "resolution": [camera.width, camera.height],
    }


FORMAT = camera_format(
    "kalibr",
    "T_cam_lidar of a camchain's camera",
    "T_cam_lidar",
    "cam0",
    make_lens=_make_lens,
    read_lens=_read_lens,
)
