"""The synthetic drives that experiments share."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from semcal_cli.config import SynthConfig
from semcal_cli.drive.document import DRIVE_FILE
from semcal_cli.errors import InputError
from semcal_cli.synthetic.synthesis import synthesize

NUM_FRAMES = 20
"""Frames of each drive in the pool, which experiments cut down."""


@dataclass(frozen=True)
class Pool:
    """Synthetic drives, one for each rig and seed, made when they are first needed."""

    folder: Path

    def drive(self, rig: str, changes: dict[str, object], seed: int) -> Path:
        """Give the drive of a rig, a `SynthConfig` with some changes.

        Raises:
            InputError: something else is where the drive goes.
        """
        path = self.folder / f"{rig}_{seed:06d}"
        if not (path / DRIVE_FILE).exists():
            config = replace(SynthConfig(num_frames=NUM_FRAMES, seed=seed), **changes)  # type: ignore[arg-type]
            self._make(config, path)
        return path

    def _make(self, config: SynthConfig, path: Path) -> None:
        """Make a drive. Other processes may want it, too: whoever is first puts it in place."""
        self.folder.mkdir(exist_ok=True)
        with TemporaryDirectory(dir=self.folder) as folder:
            made = Path(folder) / "drive"
            synthesize(config, made)
            # Nothing computes on the pictures, which are most of the bytes.
            for picture in (made / "images").iterdir():
                picture.unlink()
            try:
                made.rename(path)
            except OSError:
                if not (path / DRIVE_FILE).exists():
                    raise InputError(f"{path}: is in the way of a drive, and none") from None
