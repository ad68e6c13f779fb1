"""What a path holds that is no drive: a recording, a data set, a folder of drives, or files of the user's own."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from semcal_cli.config.data_suffixes import CLOUD_SUFFIXES, IMAGE_SUFFIXES
from semcal_cli.drive.document import DRIVE_FILE, RIG_FILE
from semcal_cli.errors import counted, shell
from semcal_cli.files.input_files import is_folder
from semcal_cli.importing import DATASETS, Dataset
from semcal_cli.importing.bags.recording_files import METADATA, SUFFIXES, is_recording

BAG, DRIVES, FOLDER = "bag", "drives", "folder"
MAX_ABOVE = 2
"""Largest number of folders above a path that are searched for the root of a data set."""
MAX_SEEN = 1000
"""Largest number of files of a folder that are looked at."""


@dataclass(frozen=True)
class Recognised:
    """What a path holds that is no drive."""

    kind: str
    """`bag`, the name of a data set, `drives`, or `folder` for a user's own clouds and images."""
    root: Path
    """The recording, or the root of the data set, as the user would write it."""
    sequence: str | None = None
    """The sequence that the path is; None for the whole data set."""
    patterns: tuple[str, ...] = ()
    """Patterns of the clouds and of the images of a folder of the user's own."""
    num_drives: int = 0
    """Number of drives in a folder of drives."""

    @property
    def is_recording(self) -> bool:
        """Whether it is a recording."""
        return self.kind == BAG

    @property
    def is_importable(self) -> bool:
        """Whether an import needs nothing but the path."""
        return self.kind not in (DRIVES, FOLDER)

    @property
    def name(self) -> str:
        """What is found, in a few words."""
        if self.kind == DRIVES:
            return f"a folder of {counted(self.num_drives, 'drive')}"
        if self.kind == FOLDER:
            return "a folder of clouds and images"
        return "a recording" if self.kind == BAG else f"the data set {self.kind}"

    @property
    def drive(self) -> Path:
        """Name for the drive that is made of it, in the working folder."""
        root = self.root.resolve()
        name = root.stem if root.is_file() and root.suffix.lower() in SUFFIXES else root.name
        return Path(f"{(self.sequence or name).replace('/', '_')}_drive")

    def command(self, output: Path, *options: str) -> str:
        """Write the command that makes a drive of it, or that calibrates the drives."""
        if self.kind == DRIVES:
            return shell("batch", self.root / "*", "-o", "results")
        if self.kind == FOLDER:
            clouds, images = self.patterns
            files = ["--points", clouds, "--images", images, "--camera-info", "FILE"]
            return shell("import", FOLDER, *files, "-o", output)
        sequence = [] if self.sequence is None else ["--sequence", self.sequence]
        return shell("import", self.kind, self.root, *sequence, *options, "-o", output)

    def advice(self, path: Path) -> str:
        """Write the error of a command that needs a drive and was given this path."""
        if self.kind == DRIVES:
            return f"{path}: found {self.name}, expected one drive; for all of them: `{self.command(Path())}`"
        return f"{path}: found {self.name}, expected a drive; first import it: `{self.command(self.drive)}`"


def recognise(path: Path) -> Recognised | None:
    """Find out what a path holds that is no drive; None for a drive, a rig, and what is not known."""
    if path.name == METADATA and is_recording(path.parent):
        return Recognised(BAG, path.parent)
    if is_folder(path):
        if any((path / name).exists() for name in (DRIVE_FILE, RIG_FILE)):
            return None
        with suppress(OSError):  # folders that may not be read
            if (source := _dataset(path) or _drives(path)) is not None:
                return source
    if is_recording(path):
        return Recognised(BAG, path)
    return _own_files(path) if is_folder(path) else None


def _dataset(path: Path) -> Recognised | None:
    """Find the data set that a folder is, or is in: the one with the most signs."""
    known = sorted(DATASETS.items(), key=lambda item: -len(item[1].signs))
    folder = path.resolve()
    for above in folder.parents[:MAX_ABOVE]:
        for name, dataset in known:
            if dataset.has_sequence_folders and _has_signs(above, dataset):
                places = [place for place in above.glob(dataset.signs[0]) if folder in place.parents]
                if places:
                    root = Path(os.path.normpath(path / os.path.relpath(above, folder)))
                    several = folder.name if dataset.joins_sequences else None
                    return Recognised(name, root, places[0].parent.name if len(places) == 1 else several)
    return next((Recognised(name, path) for name, dataset in known if _has_signs(path, dataset)), None)


def _has_signs(root: Path, dataset: Dataset) -> bool:
    return bool(dataset.signs) and all(
        any(next(root.glob(pattern), None) is not None for pattern in sign.split("|"))
        for sign in dataset.signs
    )


def _drives(path: Path) -> Recognised | None:
    num_drives = sum(1 for _ in path.glob(f"*/{DRIVE_FILE}"))
    return Recognised(DRIVES, path, num_drives=num_drives) if num_drives else None


def _own_files(path: Path) -> Recognised | None:
    """Find clouds and images in a folder, or in the folders in it."""
    clouds, images = _pattern(path, CLOUD_SUFFIXES), _pattern(path, IMAGE_SUFFIXES)
    return None if clouds is None or images is None else Recognised(FOLDER, path, patterns=(clouds, images))


def _pattern(path: Path, suffixes: tuple[str, ...]) -> str | None:
    """Write a pattern for the files of a kind in the first folder that has some."""
    for file in _files(path):
        suffix = next((suffix for suffix in suffixes if file.name.lower().endswith(suffix)), None)
        if suffix is not None:
            return str(file.parent / f"*{file.name[len(file.name) - len(suffix) :]}")
    return None


def _files(path: Path) -> Iterator[Path]:
    seen = 0
    for pattern in ("*", "*/*"):
        with suppress(OSError):
            for file in path.glob(pattern):
                seen += 1
                if seen > MAX_SEEN:
                    return
                if file.is_file():
                    yield file
