"""A sweep with all cameras of a rig around it, for the 3-D view, and the picture that each camera took of it."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

import numpy as np
import numpy.typing as npt

from semcal_cli.drive.document import Drive
from semcal_cli.drive.observations import Observations
from semcal_cli.drive.reading import load_points, read_frame_image
from semcal_cli.drive.shutter import unrolled
from semcal_cli.geometry.poses import Pose, camera_center
from semcal_cli.report.cloud import (
    GREY,
    MAX_OTHERS,
    MAX_RANGE_M,
    MAX_SEEN,
    at_pixels,
    centimetres,
    frustum,
    thinned,
)
from semcal_cli.report.colors import QUALITATIVE_COLORS
from semcal_cli.report.overlay import points_in_image
from semcal_cli.report.points import packed

Rgb = tuple[int, int, int]
BY_CAMERA, BY_PICTURE = "camera that sees them", "pictures"


@dataclass(frozen=True)
class CameraView:
    """One frame of a camera, with its points."""

    name: str
    color: Rgb
    T_camera_lidar: Pose
    drive: Drive
    """Drive of the one frame."""
    observations: Observations
    """Points of the frame, without labels."""
    is_of_sweep: bool
    """Whether the frame is of the sweep that the 3-D view shows."""


class CameraInView(TypedDict):
    """A camera as the page's script draws it, in the LiDAR frame, metres."""

    name: str
    color: Rgb
    camera_center: list[float]
    optical_axis: list[float]
    corners: list[list[float]]


class RigCloud(TypedDict):
    """What the page's script draws."""

    frame: str
    positions_cm: str
    colors: dict[str, str]
    cameras: list[CameraInView]


def camera_views(drives: Mapping[str, Drive], poses: Mapping[str, Pose]) -> list[CameraView]:
    """Read one frame of each camera that has a pose: that of the sweep that most cameras have, or else its first.

    Args:
        drives: Drive of each camera.
        poses: T_camera_lidar (4, 4) of each camera that has one.

    Raises:
        InputError: a file is missing or wrong.
    """
    sweeps = {name: [_sweep(drives[name], frame.points) for frame in drives[name].frames] for name in poses}
    common = Counter(sweep for found in sweeps.values() for sweep in dict.fromkeys(found)).most_common(1)[0][
        0
    ]
    views = []
    for number, (name, T) in enumerate(poses.items()):
        index = sweeps[name].index(common) if common in sweeps[name] else 0
        drive = drives[name].model_copy(update={"frames": (drives[name].frames[index],)})
        color = QUALITATIVE_COLORS[number % len(QUALITATIVE_COLORS)]
        observations = unrolled(load_points(drive), T)
        views.append(CameraView(name, color, T, drive, observations, common in sweeps[name]))
    return views


def _sweep(drive: Drive, name: str) -> Path:
    return Path(os.path.realpath(drive.resolve(name)))


def rig_cloud(views: list[CameraView]) -> RigCloud:
    """Colour the points of the sweep by the camera that sees them, and by the cameras' pictures.

    Raises:
        InputError: a picture is wrong.
    """
    shown = next(view for view in views if view.is_of_sweep)
    points = shown.observations.clouds[0].points
    by_camera: npt.NDArray[np.uint8] = np.full((len(points), 3), GREY, np.uint8)
    by_picture, has_picture = by_camera.copy(), False
    kept = np.zeros(len(points), np.bool_)
    # Where views overlap, the first camera has the points.
    for view in reversed(views):
        # Each camera sees the sweep at the moment of its own picture.
        own = view.observations.clouds[0].points if view.is_of_sweep else points
        seen = points_in_image(own, view.T_camera_lidar, view.observations.camera)
        chosen = thinned(~seen.is_hidden, MAX_SEEN // len(views))
        indices = seen.indices[chosen]
        kept[indices] = True
        by_camera[indices] = view.color
        image = read_frame_image(view.drive, view.drive.frames[0]) if view.is_of_sweep else None
        if image is not None:
            by_picture[indices] = at_pixels(image, seen.pixels[chosen])[:, ::-1]
            has_picture = True
    is_other = ~kept & (np.linalg.norm(points, axis=1) < MAX_RANGE_M)
    kept[thinned(is_other, MAX_OTHERS)] = True
    colors = {BY_CAMERA: packed(by_camera[kept])}
    return RigCloud(
        frame=shown.drive.frames[0].points,
        positions_cm=centimetres(points[kept]),
        colors=colors | ({BY_PICTURE: packed(by_picture[kept])} if has_picture else {}),
        cameras=[_in_view(view) for view in views],
    )


def _in_view(view: CameraView) -> CameraInView:
    T = view.T_camera_lidar
    return CameraInView(
        name=view.name,
        color=view.color,
        camera_center=camera_center(T).tolist(),
        optical_axis=T[2, :3].tolist(),
        corners=frustum(view.observations.camera, T),
    )
