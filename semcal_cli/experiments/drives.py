"""The synthetic drives of the experiments, which a pool makes once, and their calibration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from semcal_cli.config import CalibrationConfig, RefinementConfig
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.document import DRIVE_FILE, Drive, read_drive
from semcal_cli.errors import InputError
from semcal_cli.estimation.stage import StageResult
from semcal_cli.formats import read_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.pipeline import assess, make_calibration, refine_and_polish
from semcal_cli.pipeline.stages import Stages
from semcal_cli.result.calibration_document import CalibrationDocument
from semcal_cli.synthetic.synthesis import synthesize

NUM_FRAMES = 20
"""Number of frames of each drive in the pool; experiments use some of them."""


def calibrate_from(
    initial: StageResult, data: LoadedDrive, config: RefinementConfig
) -> tuple[Stages, CalibrationDocument]:
    """Do what `calibrate` does after its initial calibration.

    The pose of the stages is the one that was found; that of the calibration is the nearest rigid one.

    Raises:
        SemcalError: as `calibrate`.
    """
    stages = assess(data, refine_and_polish(data, initial, config), config)
    return stages, make_calibration(data, stages, CalibrationConfig(refinement=config))


@dataclass(frozen=True)
class Pool:
    """Synthetic drives, one for each rig and seed, which are made when they are first needed."""

    folder: Path
    has_images: bool = False
    """Whether the drives keep their images, which take most of the space and which most experiments do not read."""

    def drive(self, rig: str, changes: Mapping[str, object], seed: int) -> Path:
        """Find the drive of a rig, a `SynthConfig` with some changes, and make it if it is missing.

        Raises:
            InputError: something other than a drive is at its path.
        """
        path = self.folder / f"{rig}_{seed:06d}"
        if not (path / DRIVE_FILE).exists():
            config = replace(SynthConfig(num_frames=NUM_FRAMES, seed=seed), **changes)  # type: ignore[arg-type]
            self._make(config, path)
        return path

    def read(self, rig: str, changes: Mapping[str, object], seed: int) -> tuple[Drive, Pose]:
        """Read the document and the true T_camera_lidar (4, 4) of a drive.

        Raises:
            InputError: as `drive`.
        """
        path = self.drive(rig, changes, seed)
        drive, truth = read_drive(path), read_transform(path)
        if not self.has_images:
            frames = tuple(frame.model_copy(update={"image": None}) for frame in drive.frames)
            drive = drive.model_copy(update={"frames": frames})
        return drive, truth

    def _make(self, config: SynthConfig, path: Path) -> None:
        """Make a drive. Other processes may make it at the same time; the first one to finish puts it in place."""
        self.folder.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=self.folder) as folder:
            new_drive = Path(folder) / "drive"
            synthesize(config, new_drive)
            if not self.has_images:
                for image in (new_drive / "images").iterdir():
                    image.unlink()
            try:
                new_drive.rename(path)
            except OSError:
                if not (path / DRIVE_FILE).exists():
                    raise InputError(
                        f"{path}: found something other than a drive, expected a drive or nothing"
                    ) from None
