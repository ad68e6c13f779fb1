"""The content of a drive's files in memory, for experiments that change the files and calibrate the result."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from semcal_cli.config.file_limits import MAX_TABLE_BYTES
from semcal_cli.drive.document import DRIVE_FILE, Drive
from semcal_cli.drive.frames import Frame
from semcal_cli.files.documents import document_text
from semcal_cli.files.image_files import write_image
from semcal_cli.files.input_files import read_bytes
from semcal_cli.files.output_files import write_bytes, write_text
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse
from semcal_cli.observations.reading import read_clouds, read_label_images

Labels = npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class RawFrame:
    """Content of the files of one frame."""

    name: str
    """Name of the files, without suffix. Frames of the same name share their files, which the drive lists again."""
    points: npt.NDArray[np.float32]
    """(N, 3) metres, LiDAR frame."""
    point_labels: Labels
    """(N,) raw ids."""
    image_labels: Labels
    """(H, W) raw ids."""
    image: Path | npt.NDArray[np.uint8] | None
    """Image: a PNG to copy, or pixels (H, W, 3), blue, green, red; None if the frame has none."""
    T_camera_lidar: Pose
    """(4, 4) true pose of the camera in this frame, metres."""

    def with_camera_at(self, T_camera_lidar: Pose) -> RawFrame:
        """Give the camera another true pose.

        The camera keeps its image and the points move instead. This equals a knocked camera, except for the scan
        pattern, which tilts with the point cloud.
        """
        T = inverse(T_camera_lidar) @ self.T_camera_lidar
        return replace(self, points=transformed(T, self.points), T_camera_lidar=T_camera_lidar)

    def with_image_of(self, other: RawFrame) -> RawFrame:
        """Take the image and its labels from another frame."""
        return replace(self, image_labels=other.image_labels, image=other.image)


@dataclass(frozen=True, eq=False)
class RawDrive:
    """A drive with the content of its files."""

    drive: Drive
    """Document of the drive; its frames are replaced when it is written."""
    frames: tuple[RawFrame, ...]
    """Frames, in order."""
    unused: tuple[RawFrame, ...] = ()
    """Other frames of the same drive, which are not written."""
    has_point_labels: bool = True
    """Whether the point labels are written."""

    @property
    def num_frames(self) -> int:
        """Number of frames."""
        return len(self.frames)

    @property
    def knock(self) -> int:
        """Index of the first frame whose true pose differs from frame 0's; the number of frames if none does."""
        first = self.frames[0].T_camera_lidar
        moved = (not np.array_equal(frame.T_camera_lidar, first) for frame in self.frames)
        return next((place for place, is_moved in enumerate(moved) if is_moved), self.num_frames)

    @property
    def truths(self) -> list[Pose]:
        """Different true poses, in the order of the frames."""
        found: list[Pose] = []
        for frame in self.frames:
            if not any(np.array_equal(frame.T_camera_lidar, T) for T in found):
                found.append(frame.T_camera_lidar)
        return found

    def with_frames(self, frames: Iterable[RawFrame]) -> RawDrive:
        """Copy with other frames."""
        return replace(self, frames=tuple(frames))

    def with_document(self, **changes: object) -> RawDrive:
        """Copy with other values of some keys of drive.yaml."""
        return replace(self, drive=self.drive.model_copy(update=changes))


def transformed(T: Pose, points: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Transform points (N, 3)."""
    moved: npt.NDArray[np.float32] = (points @ T[:3, :3].T + T[:3, 3]).astype(np.float32)
    return moved


def read_raw_drive(drive: Drive, T_camera_lidar: Pose, *, prefix: str = "") -> RawDrive:
    """Read a synthetic drive.

    Args:
        drive: The drive, with ids of one byte for all points and pixels.
        T_camera_lidar: (4, 4) true pose of its camera, metres.
        prefix: Beginning of the names of the frames.

    Raises:
        InputError: a file is missing, or does not match its suffix or the drive.
    """
    frames = []
    for place, (frame, cloud, pixels) in enumerate(
        zip(drive.frames, read_clouds(drive), read_label_images(drive), strict=True)
    ):
        assert cloud.labels is not None
        assert isinstance(pixels, np.ndarray)
        shape = drive.camera.height, drive.camera.width
        frames.append(
            RawFrame(
                name=f"{prefix}{place:06d}",
                points=cloud.points,
                point_labels=cloud.labels.astype(np.uint8),
                image_labels=pixels.astype(np.uint8).reshape(shape),
                image=None if frame.image is None else drive.resolve(frame.image),
                T_camera_lidar=T_camera_lidar,
            )
        )
    return RawDrive(drive.model_copy(update={"T_camera_lidar": None}), tuple(frames))


def write_raw_drive(raw: RawDrive, folder: Path) -> Path:
    """Write a drive into an existing folder, and return its drive.yaml.

    Raises:
        InputError: a file cannot be written.
    """
    for frame in {frame.name: frame for frame in raw.frames}.values():
        records = np.zeros((len(frame.points), 4), "<f4")
        records[:, :3] = frame.points
        write_bytes(records.tobytes(), folder / f"{frame.name}.bin")
        if raw.has_point_labels:
            write_bytes(frame.point_labels.astype("<u4").tobytes(), folder / f"{frame.name}.label")
        write_image(frame.image_labels, folder / f"{frame.name}_labels.png")
        if isinstance(frame.image, Path):
            write_bytes(read_bytes(frame.image, limit=MAX_TABLE_BYTES), folder / f"{frame.name}.png")
        elif frame.image is not None:
            write_image(frame.image, folder / f"{frame.name}.png")
    listed = tuple(_listed(frame, raw.has_point_labels) for frame in raw.frames)
    document = raw.drive.model_copy(update={"frames": listed})
    text = document_text(document.model_dump(mode="json", exclude_none=True), "yaml")
    write_text(text, folder / DRIVE_FILE)
    return folder / DRIVE_FILE


def _listed(frame: RawFrame, has_point_labels: bool) -> Frame:
    return Frame(
        points=f"{frame.name}.bin",
        point_labels=f"{frame.name}.label" if has_point_labels else None,
        image_labels=f"{frame.name}_labels.png",
        image=None if frame.image is None else f"{frame.name}.png",
    )
