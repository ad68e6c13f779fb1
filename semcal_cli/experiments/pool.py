"""The synthetic drives that experiments share."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.document import DRIVE_FILE, Drive, read_drive
from semcal_cli.errors import InputError
from semcal_cli.formats import read_transform
from semcal_cli.geometry.poses import Pose
from semcal_cli.synthetic.synthesis import synthesize

NUM_FRAMES = 20
"""Number of frames of each drive in the pool; experiments use some of them."""


def with_frames(drive: Drive, places: Iterable[int]) -> Drive:
    """Copy of a drive with some of its frames, by their indices."""
    return drive.model_copy(update={"frames": tuple(drive.frames[place] for place in places)})


def consecutive(drive: Drive, num_frames: int, seed: int) -> Drive:
    """Copy of a drive with some frames in a row, from one that the seed chooses; all if it has no more."""
    num_starts = max(len(drive.frames) - num_frames + 1, 1)
    first = seed % num_starts
    return with_frames(drive, range(first, min(first + num_frames, len(drive.frames))))


@dataclass(frozen=True)
class Pool:
    """Synthetic drives, one for each rig and seed, made when they are first needed."""

    folder: Path
    has_pictures: bool = False
    """Whether the drives keep their pictures, which are most of the bytes and which most experiments do not read."""

    def drive(self, rig: str, changes: dict[str, object], seed: int) -> Path:
        """Path of the drive of a rig, a `SynthConfig` with some changes; the drive is made if it is missing.

        Raises:
            InputError: something else is at the drive's path.
        """
        path = self.folder / f"{rig}_{seed:06d}"
        if not (path / DRIVE_FILE).exists():
            config = replace(SynthConfig(num_frames=NUM_FRAMES, seed=seed), **changes)  # type: ignore[arg-type]
            self._make(config, path)
        return path

    def read(self, rig: str, changes: dict[str, object], seed: int) -> tuple[Drive, Pose]:
        """Read the document and the true T_camera_lidar (4, 4) of a drive.

        Raises:
            InputError: as `drive`.
        """
        path = self.drive(rig, changes, seed)
        drive, truth = read_drive(path), read_transform(path)
        if not self.has_pictures:
            frames = tuple(frame.model_copy(update={"image": None}) for frame in drive.frames)
            drive = drive.model_copy(update={"frames": frames})
        return drive, truth

    def _make(self, config: SynthConfig, path: Path) -> None:
        """Make a drive. Other processes may make it at the same time: the first one to finish puts it in place."""
        self.folder.mkdir(exist_ok=True)
        with TemporaryDirectory(dir=self.folder) as folder:
            made = Path(folder) / "drive"
            synthesize(config, made)
            if not self.has_pictures:
                for picture in (made / "images").iterdir():
                    picture.unlink()
            try:
                made.rename(path)
            except OSError:
                if not (path / DRIVE_FILE).exists():
                    raise InputError(f"{path}: is in the way of a drive, and none") from None
