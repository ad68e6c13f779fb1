"""Synthetic drives: ray-cast streets with exact labels, seen by a rig with known extrinsics."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from semcal_cli import core
from semcal_cli.config.file_limits import MAX_CAMERAS
from semcal_cli.config.synthetic import SYNTH_MIN_BASELINE_M, SynthConfig, SynthLens
from semcal_cli.drive.camera import Camera, CameraModel, core_camera
from semcal_cli.drive.document import DRIVE_FILE, RIG_FILE
from semcal_cli.errors import InputError
from semcal_cli.files.documents import document_text
from semcal_cli.files.output_files import make_folder, write_text
from semcal_cli.geometry.arrays import Pose, Vector
from semcal_cli.geometry.poses import pose_from_mounting
from semcal_cli.geometry.twists import rotation_matrix
from semcal_cli.synthetic.frame_files import (
    IMAGE_FOLDERS,
    SWEEP_FOLDERS,
    UNLABELED,
    DrivePlace,
    frame_document,
    name_folder_in_errors,
    write_frame,
)
from semcal_cli.synthetic.street_motion import (
    LIDAR_MOUNTING,
    MOUNTING,
    POSES_FILE,
    check_motion,
    generator,
    poses_text,
    shutter,
)

PITCH_DEG, ROLL_DEG = 8.0, 4.0
CENTER_BOX_M = np.array([1.0, 1.0, 0.6])
"""Maximum coordinates of a randomly mounted camera in the LiDAR frame, in both directions."""
LIDAR_DISTANCE_M, LIDAR_SPREAD = (0.5, 1.0), np.array([1.0, 1.0, 0.3])
"""Distances of further LiDARs from the first one, and how far they spread along its axes, relative to one another."""
ALONE = DrivePlace()
"""Place of a drive that is alone."""

# Model, distortion in OpenCV's order, horizontal field of view. Each lens is monotone over its field of view.
LENSES: dict[SynthLens, tuple[CameraModel, tuple[float, ...], float]] = {
    "standard": ("plumb_bob", (0.0, 0.0, 0.0, 0.0, 0.0), 90.0),
    "narrow": ("plumb_bob", (-0.12, 0.05, 0.0008, -0.0005, 0.0), 35.0),
    "wide": ("rational_polynomial", (0.4, 0.02, 0.0005, -0.0003, 0.0, 0.62, 0.06, 0.0), 100.0),
    "fisheye": ("fisheye", (-0.012, 0.002, -0.0006, 0.0), 200.0),
    "omnidirectional": ("omnidirectional", (-0.05, 0.01, 0.0005, -0.0003), 190.0),
    "equirectangular": ("equirectangular", (), 360.0),
}
LENS_PARAMETERS: dict[SynthLens, dict[str, float]] = {"omnidirectional": {"xi": 1.2}}


@dataclass(frozen=True)
class SynthSummary:
    """Summary of a written drive."""

    num_frames: int
    """Number of frames."""
    num_points: int
    """Number of points in all frames."""
    num_classes: int
    """Number of classes of points and pixels together, before label noise."""


NOTHING_WRITTEN = SynthSummary(0, 0, 0)


def synthesize(
    config: SynthConfig,
    out: Path,
    progress: Callable[[int], None] | None = None,
    *,
    force: bool = False,
    sweeps: str | None = None,
    camera: int = 0,
) -> SynthSummary:
    """Write a drive with its true transform. The same config gives the same bytes.

    `drive.yaml` is written last, so a folder with a `drive.yaml` is complete.

    Args:
        config: Settings of the drive.
        out: Folder to write; it is created if it does not exist.
        progress: Called with the number of finished frames.
        force: Whether to write into a folder that is not empty; files with other names are kept.
        sweeps: Folder, relative to `out`, of another camera's drive in the same world with the same LiDAR. Its point
            clouds are listed instead of written again.
        camera: Number of the camera in a rig; the label noise differs between the cameras.

    Raises:
        InputError: the folder is not empty or cannot be written, or the rig or its motion is impossible.
    """
    return _synthesize(config, out, DrivePlace(camera, sweeps=sweeps), progress, force=force)


def _synthesize(
    config: SynthConfig,
    out: Path,
    place: DrivePlace,
    progress: Callable[[int], None] | None,
    *,
    force: bool,
) -> SynthSummary:
    """Write a drive in its place in a rig, as `synthesize` does."""
    check_motion(config)
    T_camera_first = mounting(config)
    renderer = make_renderer(config, T_camera_first, place)
    _check_empty(out, force)
    with name_folder_in_errors(out):
        for folder in SWEEP_FOLDERS + IMAGE_FOLDERS:
            if not place.prefix(folder):
                make_folder(out / folder, out)
        (out / DRIVE_FILE).unlink(missing_ok=True)
    # Rust renders one frame at a time on all cores, while the other thread writes the previous frame.
    with ThreadPoolExecutor(max_workers=2) as threads:
        frames = []
        write = partial(write_frame, config, renderer, out, place)
        for frame in threads.map(write, range(0 if place.is_listed else config.num_frames)):
            frames.append(frame)
            if progress is not None:
                progress(len(frames))
    if config.motion != "none" and place.sweeps is None:
        write_text(poses_text(config), out / POSES_FILE)
    T_camera_lidar = T_camera_first if place.T_first_lidar is None else T_camera_first @ place.T_first_lidar
    write_text(document_text(_drive_document(config, T_camera_lidar, place), "yaml"), out / DRIVE_FILE)
    return SynthSummary(
        num_frames=len(frames),
        num_points=sum(frame.num_points for frame in frames),
        num_classes=len(frozenset().union(*(frame.classes for frame in frames)) - {UNLABELED}),
    )


def synthesize_rig(
    config: SynthConfig,
    num_cameras: int,
    out: Path,
    progress: Callable[[int], None] | None = None,
    *,
    force: bool = False,
    num_lidars: int = 1,
) -> SynthSummary:
    """Write a drive for each of several cameras, evenly spaced around the first LiDAR, and a `rig.yaml`.

    The random part of the mounting is drawn for each camera. Each camera also has a drive with each further LiDAR,
    which lies within a metre of the first one and looks anywhere.

    Args:
        config: Settings of the drives.
        num_cameras: Number of cameras.
        num_lidars: Number of LiDARs.
        out: Folder to write; it is created if it does not exist.
        progress: Called with the number of finished frames.
        force: Whether to write into a folder that is not empty; files with other names are kept.

    Returns:
        The summary of the last camera's drive with the first LiDAR.

    Raises:
        InputError: the folder is not empty or cannot be written, or the rig or its motion is impossible.
    """
    check_motion(config)
    if num_lidars > 1 and config.motion != "none":
        raise InputError(f"--lidars: found {num_lidars} and --motion {config.motion}, expected --motion none")
    if num_cameras * (num_lidars - 1) > MAX_CAMERAS:
        raise InputError(
            f"--lidars: found {num_lidars} and --cameras {num_cameras}, expected at most {MAX_CAMERAS} drives with "
            "further LiDARs"
        )
    _check_empty(out, force)
    with name_folder_in_errors(out):
        (out / RIG_FILE).unlink(missing_ok=True)
    rig_seed = config.seed if config.rig_seed is None else config.rig_seed
    first_deg = config.camera_azimuth_deg or 0.0
    names = [f"camera_{index}" for index in range(num_cameras)]
    num_done, summary = 0, NOTHING_WRITTEN

    def tell(num_frames: int) -> None:
        if progress is not None:
            progress(num_done + num_frames)

    T_first_lidar = {f"lidar_{number}": lidar_mounting(config, number) for number in range(1, num_lidars)}
    for folder, place in _rig_places(names, T_first_lidar).items():
        azimuth_deg = (first_deg + 360.0 * place.camera / num_cameras + 180.0) % 360.0 - 180.0
        camera = replace(config, rig_seed=rig_seed + place.camera, camera_azimuth_deg=azimuth_deg)
        make_folder(out / folder, out)
        written = _synthesize(camera, out / folder, place, tell, force=force)
        summary = summary if place.lidar else written
        num_done += config.num_frames
    write_text(document_text(_rig_document(names, T_first_lidar), "yaml"), out / RIG_FILE)
    return summary


def _rig_places(cameras: list[str], T_first_lidar: Mapping[str, Pose]) -> dict[str, DrivePlace]:
    """List the drives of a rig by their folders: each camera with the first LiDAR, then with each further one."""
    places = {}
    for number, lidar in enumerate(["", *T_first_lidar]):
        folders = [f"{camera}_on_{lidar}" if lidar else camera for camera in cameras]
        for index, (camera, folder) in enumerate(zip(cameras, folders, strict=True)):
            sweeps, images = f"../{folders[0]}" if index else None, f"../{camera}" if lidar else None
            places[folder] = DrivePlace(index, number, T_first_lidar.get(lidar), sweeps, images)
    return places


def _rig_document(cameras: list[str], T_first_lidar: Mapping[str, Pose]) -> dict[str, Any]:
    """Make the document of a rig, with the true transforms between its LiDARs for comparison."""
    document: dict[str, Any] = {"semcal_rig": 1, "cameras": {camera: camera for camera in cameras}}
    if T_first_lidar:
        document["lidars"] = {
            lidar: {"cameras": {camera: f"{camera}_on_{lidar}" for camera in cameras}}
            for lidar in T_first_lidar
        }
        document["T_lidar_lidar"] = {"lidar": {lidar: T.tolist() for lidar, T in T_first_lidar.items()}}
    return document


def lidar_mounting(config: SynthConfig, number: int) -> Pose:
    """Mount a further LiDAR of a rig at random.

    Returns:
        T_first_lidar (4, 4), its pose in the frame of the first one, metres.
    """
    rig = config if config.rig_seed is None else replace(config, seed=config.rig_seed)
    rng = generator(rig, LIDAR_MOUNTING, number)
    yaw, pitch, roll = np.radians(rng.uniform((-180.0, -PITCH_DEG, -ROLL_DEG), (180.0, PITCH_DEG, ROLL_DEG)))
    direction = rng.standard_normal(3) * LIDAR_SPREAD
    T: Pose = np.eye(4)
    for axis, angle in zip(np.eye(3), (roll, pitch, yaw), strict=True):
        T[:3, :3] = rotation_matrix(angle * axis) @ T[:3, :3]
    T[:3, 3] = rng.uniform(*LIDAR_DISTANCE_M) * direction / np.linalg.norm(direction)
    return T


def mounting(config: SynthConfig) -> Pose:
    """Mount the camera as the config states, and at random where the config has None.

    Returns:
        T_camera_lidar (4, 4), metres.
    """
    rig = config if config.rig_seed is None else replace(config, seed=config.rig_seed)
    rng = generator(rig, MOUNTING)
    azimuth, pitch, roll = rng.uniform((-180.0, -PITCH_DEG, -ROLL_DEG), (180.0, PITCH_DEG, ROLL_DEG))
    angles = config.camera_azimuth_deg, config.camera_pitch_deg, config.camera_roll_deg
    random_angles = azimuth, pitch, roll
    azimuth, pitch, roll = (
        one if other is None else other for one, other in zip(random_angles, angles, strict=True)
    )
    return pose_from_mounting((roll, -pitch, azimuth), _camera_center(config, rng).tolist())


def make_camera(config: SynthConfig) -> Camera:
    """Make the camera whose image spans the horizontal field of view through its lens.

    Raises:
        InputError: the lens does not reach this field of view.
    """
    model, distortion, lens_hfov_deg = LENSES[config.lens]
    hfov_deg = lens_hfov_deg if config.hfov_deg is None else config.hfov_deg
    focal = round(config.width / _width_at_unit_focal(config.lens, math.radians(0.5 * hfov_deg)), 6)
    cx, cy = 0.5 * (config.width - 1), 0.5 * (config.height - 1)
    document = {
        "model": model,
        "width": config.width,
        "height": config.height,
        "K": ((focal, 0.0, cx), (0.0, focal, cy), (0.0, 0.0, 1.0)),
        "distortion": distortion,
        "intrinsics_sigma": {"fx": 0.0, "fy": 0.0, "cx": 0.0, "cy": 0.0},
    }
    if config.lens in LENS_PARAMETERS:
        document["parameters"] = LENS_PARAMETERS[config.lens]
    return Camera.model_validate(document)


def _width_at_unit_focal(lens: SynthLens, half_angle: float) -> float:
    """Compute the width of an image with focal length one that spans an angle to both sides of the optical axis."""
    model, distortion, _ = LENSES[lens]
    if model == "equirectangular":
        return 2.0 * half_angle
    camera = core.Camera(model, 1, 1, np.eye(3).tolist(), distortion, LENS_PARAMETERS.get(lens, {}))
    across, ahead = math.sin(half_angle), math.cos(half_angle)
    left, right = camera.project(np.array([[-across, 0.0, ahead], [across, 0.0, ahead]]))[:, 0]
    width = float(right - left)
    if not math.isfinite(width):
        raise InputError(
            f"--hfov-deg: found {math.degrees(2.0 * half_angle):g}, which the {lens} lens does not reach"
        )
    return width


def make_renderer(config: SynthConfig, T_camera_first: Pose, place: DrivePlace = ALONE) -> core.Renderer:
    """Make the renderer of a LiDAR and a camera.

    Args:
        config: Settings of the drive.
        T_camera_first: (4, 4), from the first LiDAR to the camera, metres.
        place: Place of the drive in a rig.

    Raises:
        InputError: a sensor is too far from the first LiDAR, or the LiDAR has no rays.
    """
    camera = core_camera(make_camera(config))
    return core.Renderer(camera, T_camera_first, config, place.T_first_lidar, place.lidar)


def _camera_center(config: SynthConfig, rng: np.random.Generator) -> Vector:
    """Draw the position of the camera, (3,) metres in the LiDAR frame."""
    distance = math.inf
    while not SYNTH_MIN_BASELINE_M <= distance <= config.max_baseline_m:
        center: Vector = rng.uniform(-CENTER_BOX_M, CENTER_BOX_M)
        distance = float(np.linalg.norm(center))
    return center if config.baseline_m is None else center * (config.baseline_m / distance)


def _check_empty(out: Path, force: bool) -> None:
    with name_folder_in_errors(out):
        if not force and out.is_dir() and any(out.iterdir()):
            raise InputError(
                f"{out}: the folder is not empty; name another folder, or write into it with --force"
            )


def _drive_document(config: SynthConfig, T_camera_lidar: Pose, place: DrivePlace) -> dict[str, Any]:
    document: dict[str, Any] = {"semcal_drive": 1}
    document["camera"] = make_camera(config).model_dump(mode="json", exclude_unset=True) | shutter(config)
    if config.pattern == "spinning":
        keys = ("channels", "columns", "fov_up_deg", "fov_down_deg")
        document["lidar"] = {key: getattr(config, key) for key in keys}
    document["frames"] = [frame_document(config, number, place) for number in range(config.num_frames)]
    document["ignore"] = {"points": [UNLABELED], "image": [UNLABELED]}
    if config.ontology == "shared":
        names = {name: [id_] for id_, name in core.synthetic_classes()}
        document["classes"] = {"points": names, "image": names}
    if config.motion != "none":
        document["motion"] = {"poses": place.prefix("points") + POSES_FILE}
    # The delay of a moving rig is for the calibration to find.
    document["synchronization"] = "hardware" if config.motion == "none" else "stamps"
    document["T_camera_lidar"] = T_camera_lidar.tolist()
    return document
