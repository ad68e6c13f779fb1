"""The calibration that a program gets: the document, with methods to draw, show and save it."""

from __future__ import annotations

import base64
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from pydantic import PrivateAttr

from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.errors import SemcalError
from semcal_cli.files.array_forms import COLORS, POINTS, Form, check_array, image_of
from semcal_cli.formats import write_transform
from semcal_cli.formats.format import FormatOptions
from semcal_cli.geometry.poses import camera_center
from semcal_cli.observations.reading import read_clouds, read_needed_image
from semcal_cli.readable import signed
from semcal_cli.result.calibration_document import (
    CalibrationDocument,
    read_calibration as read_document,
    write_calibration,
)

WIDTH_PX = 640
"""Width of the image that a notebook shows; smaller images are not enlarged."""
QUALITY = 80
"""JPEG quality of that image."""


class Calibration(CalibrationDocument):
    """Transform between a LiDAR and a camera, with its uncertainty and quality; a notebook shows it."""

    _drive: Drive | Path | str | None = PrivateAttr(default=None)

    @classmethod
    def of(cls, document: CalibrationDocument, drive: Drive | Path | str | None = None) -> Calibration:
        """Share the content of a checked document; `drive` has the image that a notebook shows."""
        calibration = cls.model_construct(document.model_fields_set, **dict(document))
        calibration._drive = drive
        return calibration

    def __eq__(self, other: object) -> bool:
        """Whether both have the same content; their drives are not compared."""
        return isinstance(other, CalibrationDocument) and self.model_dump() == other.model_dump()

    def overlay(self, image: npt.NDArray[np.uint8], points: npt.ArrayLike) -> npt.NDArray[np.uint8]:
        """Draw points on a darkened image, from red (near) to blue (far); points that nearer ones hide are left out.

        Args:
            image: (H, W), or (H, W, 3) red, green, blue, of the camera's size; uint8. It is not changed.
            points: (N, 3) or (N, 4) metres, LiDAR frame; a fourth column is ignored.

        Returns:
            (H, W, 3) red, green, blue.

        Raises:
            InputError: the image or the points have the wrong shape or type.
        """
        from semcal_cli.report.overlays import draw_depths

        camera, array = self.used_camera, np.asarray(points)
        size = camera.height, camera.width
        check_array("image", image, [Form(size, *COLORS), Form((*size, 3), *COLORS)])
        check_array("points", array, POINTS)
        xyz = np.ascontiguousarray(array[:, :3], np.float32)
        return image_of(draw_depths(image_of(image), xyz, self.T_camera_lidar, camera))

    def save(self, path: Path | str, to: str | None = None, options: FormatOptions | None = None) -> None:
        """Write the calibration to a file, as a whole or not at all.

        Args:
            path: File to write.
            to: Name of the format of another tool, such as `ros2-static-transform`: `semcal convert --formats` lists
                them. None writes the whole calibration, as YAML or JSON by the suffix.
            options: Options of that format, such as the names of frames.

        Raises:
            InputError: the format is unknown or needs an option, or the file cannot be written.
        """
        if to is None:
            write_calibration(self, path)
            return
        given = options or FormatOptions()
        own = replace(
            given,
            intrinsics=given.intrinsics or self.used_camera,
            covariance=self.believed_covariance if given.covariance is None else given.covariance,
            frame_ids=given.frame_ids or self.input.frame_ids,
        )
        write_transform(self.T_camera_lidar, path, to, own)

    def __str__(self) -> str:
        """Return about ten lines: the verdict, the transform, where it puts the camera, and what speaks against it."""
        from semcal_cli.report import words

        verdict, T = words.verdict_of(self), self.T_camera_lidar
        rows = [" ".join(f"{value:10.6f}" for value in row) for row in T]
        lines = [
            f"{verdict.title}. {signed(verdict.figures)}".strip(),
            *(f"{label:<15} {row}" for label, row in zip(["T_camera_lidar", "", "", ""], rows, strict=True)),
            f"camera at       {' '.join(f'{value:.4f}' for value in camera_center(T))} m in the LiDAR frame",
            f"looks along     {' '.join(f'{value:.4f}' for value in T[2, :3])} in the LiDAR frame",
        ]
        if self.reasons:
            more = f" (and {len(self.reasons) - 1} more in .reasons)" if len(self.reasons) > 1 else ""
            lines.append(f"reason          {self.reasons[0]}{more}")
        return "\n".join(lines)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        """Show the verdict, the interval and the points of the first image, in a notebook."""
        from semcal_cli.report import words
        from semcal_cli.report.template import ENVIRONMENT

        template = ENVIRONMENT.get_template("api/calibration.html")
        rows = [" ".join(f"{value:12.6f}" for value in row) for row in self.T_camera_lidar]
        return template.render(verdict=words.verdict_of(self), rows=rows, jpeg=self._jpeg())

    def _jpeg(self) -> str | None:
        """Draw the points of the first frame with an image, as a JPEG in base64; None if it cannot be read."""
        import cv2

        with suppress(SemcalError):
            drive = self._drive if isinstance(self._drive, Drive | None) else read_drive(self._drive)
            frames = () if drive is None else drive.frames
            for frame in (each for each in frames if each.image is not None):
                assert drive is not None
                one = drive.model_copy(update={"frames": (frame,)})
                (cloud,), image = read_clouds(one), read_needed_image(one, frame)
                drawn = self.overlay(image_of(image), cloud.points)
                scale = min(1.0, WIDTH_PX / drawn.shape[1])
                small = cv2.resize(drawn[..., ::-1], None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
                _, content = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
                return base64.b64encode(content.tobytes()).decode()
        return None


def read_calibration(path: Path | str) -> Calibration:
    """Read and check a calibration.

    Raises:
        InputError: the file is wrong; the message names the file, the key, what was found and what was needed.
    """
    return Calibration.of(read_document(path))
