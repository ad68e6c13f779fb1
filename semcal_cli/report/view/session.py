"""Answers to the page: points, agreement and information at a pose, and a calibration from there."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from semcal_cli.config import CalibrationConfig
from semcal_cli.drive.camera import core_camera
from semcal_cli.errors import InputError
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.files.array_forms import SweepCloud
from semcal_cli.files.documents import document_text, output_format
from semcal_cli.files.output_files import write_text
from semcal_cli.formats.node import rigid
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import pose_from_mounting
from semcal_cli.geometry.twists import pose_at
from semcal_cli.observations.frame_naming import frame_names
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.observations.observations import Observations
from semcal_cli.pipeline import calibrate
from semcal_cli.readable import signed
from semcal_cli.report.colors import coloring_of, page_colors
from semcal_cli.report.notations import T_notation
from semcal_cli.report.overlays import edge_image, image_of
from semcal_cli.report.points import View, associated_classes, encode_base64, frame_points
from semcal_cli.report.view.pairs import Panorama, pose_of_pairs, read_pairs
from semcal_cli.report.words import verdict_of

MAX_POINTS = 40_000
"""Largest number of points of an image."""
MAX_COLUMNS, QUALITY = 1920, 85
"""Columns of an image, and its quality as JPEG."""
MAX_OFFSET = 1e4
"""Largest offset in metres or degrees."""
MAX_TRANSLATION_M = 1e4
"""Largest translation of a pose."""
MOUNTINGS = {
    "forward, along x": (0.0, 0.0, 0.0),
    "left, along y": (0.0, 0.0, 90.0),
    "back, against x": (0.0, 0.0, 180.0),
    "right, against y": (0.0, 0.0, -90.0),
    "up, along z": (0.0, -90.0, 0.0),
    "down, against z": (0.0, 90.0, 0.0),
}
"""Roll, pitch and yaw in degrees of upright cameras, by the direction they look in, in the LiDAR frame."""
INTENSITIES = (0.01, 0.99)
"""Quantiles of intensity at the ends of the colour scale."""


@dataclass(frozen=True)
class MovedPose:
    """A pose that the page shows: where it started, and how far it was moved from there."""

    T_base: Pose
    """(4, 4) T_camera_lidar before it is moved."""
    offsets: npt.NDArray[np.float64]
    """(6,) motion of the camera's centre along its axes, metres, then degrees about them: see `result.uncertainty`."""

    @property
    def T_camera_lidar(self) -> Pose:
        """(4, 4) the moved pose: the centre is shifted along the axes, then what the camera sees is turned."""
        return pose_at(self.T_base, np.concatenate([-self.offsets[:3], np.radians(self.offsets[3:])]))

    @classmethod
    def read(cls, request: dict[str, Any]) -> MovedPose:
        """Read what the page sends: `base`, 4 x 4, and `offsets`, six numbers.

        Raises:
            InputError: they are not.
        """
        try:
            T, offsets = np.array(request["base"], float), np.array(request["offsets"], float)
        except (KeyError, TypeError, ValueError, OverflowError):
            raise InputError("view: found no base and offsets, needed 4 x 4 and 6 numbers") from None
        if T.shape != (4, 4) or offsets.shape != (6,):
            raise InputError(f"view: found {T.shape} and {offsets.shape}, needed 4 x 4 and 6 numbers")
        if not np.isfinite(offsets).all() or np.abs(offsets).max() > MAX_OFFSET:
            raise InputError(f"view: offsets: found {offsets.tolist()}, needed at most {MAX_OFFSET:g}")
        return cls(rigid("view: base", T, MAX_TRANSLATION_M), offsets)


class Session:
    """A drive as the page asks for it. Requests may be concurrent."""

    def __init__(
        self,
        data: LoadedDrive,
        clouds: Sequence[SweepCloud],
        config: CalibrationConfig,
        start: Pose | None = None,
        output: Path | None = None,
        unlabelled: str = "",
    ) -> None:
        """Take a loaded drive.

        Args:
            data: The drive, as `load` returns it; without classes if it has no labels.
            clouds: Its sweeps as they were read, for their intensities.
            config: Settings of calibrations that start at a pose of the page.
            start: (4, 4) T_camera_lidar that the page starts with; None offers mountings.
            output: File that a pose is saved to; None if the browser saves it.
            unlabelled: Reason why points have no classes; empty if they have.
        """
        self.data = data if start is None else data.along_scans(start)
        self.config, self.output, self.unlabelled = config, output, unlabelled
        self.start, self.has_saved = start, False
        self._intensities = [_levels(cloud) for cloud in clouds]
        self._refining = threading.Lock()

    @property
    def observations(self) -> Observations:
        """Observations that are shown and scored: of one cue, by classes that all frames share."""
        return self.data.checked_by.of_classes

    @cached_property
    def page(self) -> dict[str, Any]:
        """Content of the page that does not depend on the pose."""
        observations, camera = self.observations, self.data.drive.camera
        has_labels, has_intensities = (
            not self.unlabelled,
            all(levels is not None for levels in self._intensities),
        )
        choices = [coloring_of(observations)] * has_labels + ["depth"]
        choices += ["intensity"] * has_intensities + ["agreement"] * has_labels
        classes = np.concatenate([cloud.classes for cloud in observations.clouds])
        tables, legends = page_colors(observations, classes)
        return {
            "frames": frame_names([frame.points for frame in self.data.drive.frames]),
            "width": camera.width,
            "height": camera.height,
            "degrees_per_pixel": float(np.degrees(1.0 / core_camera(camera).pixels_per_radian)),
            "choices": choices,
            "palette": tables,
            "legends": legends,
            "is_photograph": [frame.image is not None for frame in self.data.drive.frames],
            "unlabelled": self.unlabelled,
            "saves_to": None if self.output is None else str(self.output),
            "unit": observations.unit,
            "start": None if self.start is None else self.start.tolist(),
            "mountings": {
                name: pose_from_mounting(rpy, (0.0,) * 3).tolist() for name, rpy in MOUNTINGS.items()
            },
        }

    def image(self, frame: int, *, by_edge: bool = False) -> bytes:
        """Encode the image of a frame, or a drawing of its edges, as JPEG.

        Raises:
            InputError: there is no such frame, or its image is wrong.
        """
        self._check_frame(frame)
        if by_edge:
            image = edge_image(self.data.drive, self.observations, frame)
        else:
            image, _ = image_of(self.data.drive, self.observations, frame)
        if image.shape[1] > MAX_COLUMNS:
            size = MAX_COLUMNS, max(1, round(image.shape[0] * MAX_COLUMNS / image.shape[1]))
            image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
        _, content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        return content.tobytes()

    def sweep(self, frame: int) -> bytes:
        """Encode the picture of a sweep, on which points are picked, as JPEG.

        Raises:
            InputError: there is no such frame.
        """
        _, content = cv2.imencode(".jpg", self._panorama(frame).draw(), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        return content.tobytes()

    def pick(self, request: dict[str, Any]) -> dict[str, Any]:
        """Find the point of a sweep that was clicked on.

        Raises:
            InputError: there is no such frame, or no point there.
        """
        frame, at = request.get("frame"), request.get("at")
        self._check_frame(frame)
        assert isinstance(frame, int)
        if (
            not isinstance(at, list)
            or len(at) != 2
            or not all(isinstance(value, int | float) for value in at)
        ):
            raise InputError(f"view: at: found {at!r}, expected a column and a row")
        point, position = self._panorama(frame).pick(*map(float, at))
        return {"point": point, "at": position}

    def pairs(self, request: dict[str, Any]) -> dict[str, Any]:
        """Find the pose of pairs of a point and a pixel, with the camera near the pose of the page.

        Raises:
            InputError: there is no such pose, or the pairs determine none.
        """
        T_start = MovedPose.read(request).T_camera_lidar
        T, error_px = pose_of_pairs(*read_pairs(request.get("pairs")), self.data.drive.camera, T_start)
        return {"T": rigid("view: pairs", T, MAX_TRANSLATION_M).tolist(), "error_px": error_px}

    def points(self, request: dict[str, Any]) -> dict[str, Any]:
        """Project the points of a frame at a pose, and compare all frames there.

        Raises:
            InputError: there is no such frame, or no such pose.
        """
        pose, frame = MovedPose.read(request), request.get("frame")
        self._check_frame(frame)
        assert isinstance(frame, int)
        T, camera = pose.T_camera_lidar, self.data.drive.camera
        view = View(self.observations, T)
        agreement = None if self.unlabelled else view.agreement()
        is_associated = np.zeros((0, 0), bool) if agreement is None else associated_classes(agreement)
        visible = frame_points([view], frame, is_associated)
        chosen = visible.thin(MAX_POINTS)
        encoded = chosen.encode(camera.width, camera.height)
        levels = self._intensities[frame]
        if levels is not None:
            encoded["intensities"] = encode_base64(levels[chosen.indices])
        return {
            "T": T.tolist(),
            "text": T_notation(T).text,
            "points": encoded,
            "agreement_of_frame": None if self.observations.is_multimodal else visible.poses[0].agreement,
            "num_visible": int(visible.poses[0].is_visible.sum()),
            "information": None if agreement is None else agreement.mutual_information - agreement.bias,
        }

    def refine(self, request: dict[str, Any]) -> dict[str, Any]:
        """Calibrate from a pose, as `semcal calibrate --init` does from the saved one.

        Raises:
            InputError: there is no such pose, the drive has no labels, or another calibration is still running.
            CalibrationError: the data give no answer.
        """
        if self.unlabelled:
            raise InputError(self.unlabelled)
        start = InitialPose(MovedPose.read(request).T_camera_lidar, name="the pose of the page")
        if not self._refining.acquire(blocking=False):
            raise InputError("view: a calibration is still running; wait until it has finished")
        try:
            calibration = calibrate(self.data, self.config, initial_pose=start)
        finally:
            self._refining.release()
        verdict = verdict_of(calibration)
        return {
            "T": calibration.pose.tolist(),
            "status": verdict.status,
            "title": verdict.title,
            "figures": signed(verdict.figures),
            "reasons": [reason.sentence for reason in verdict.reasons],
        }

    def save(self, request: dict[str, Any]) -> dict[str, Any]:
        """Write a pose to the file that was asked for, and return its text if the browser is to save it.

        Raises:
            InputError: there is no such pose, or the file cannot be written.
        """
        T = MovedPose.read(request).T_camera_lidar
        format = "yaml" if self.output is None else output_format(self.output)
        text = document_text({"T_camera_lidar": T.tolist()}, format)
        if self.output is not None:
            write_text(text, self.output)
            self.has_saved = True
        return {"path": None if self.output is None else str(self.output), "text": text}

    def check_images(self) -> None:
        """Check that each frame has something to show.

        Raises:
            InputError: a frame has neither an image nor labels, or its image is wrong.
        """
        for frame in range(len(self.data.drive.frames)):
            image_of(self.data.drive, self.observations, frame)

    def _panorama(self, frame: int) -> Panorama:
        self._check_frame(frame)
        return Panorama.of_points(self.observations.clouds[frame].points)

    def _check_frame(self, frame: object) -> None:
        num_frames = len(self.data.drive.frames)
        if not isinstance(frame, int) or isinstance(frame, bool) or not 0 <= frame < num_frames:
            raise InputError(f"view: frame: found {frame!r}, expected one of 0 to {num_frames - 1}")


def _levels(cloud: SweepCloud) -> npt.NDArray[np.uint8] | None:
    """Return the levels (N,) of a sweep's intensities, 0 to 255; None if it has none."""
    if cloud.intensity is None or len(cloud.intensity) == 0:
        return None
    low, high = np.quantile(cloud.intensity, INTENSITIES)
    share = (cloud.intensity - low) / max(float(high - low), 1e-9)
    return np.asarray(np.rint(255.0 * np.clip(np.nan_to_num(share), 0.0, 1.0)), np.uint8)
