"""Labelled drives: label files, and a drive.yaml that adds them to the files of the original drive."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from semcal_cli.drive.document import Drive, output_drive_file
from semcal_cli.drive.frames import FILES
from semcal_cli.drive.networks import SecondLabels
from semcal_cli.errors import InputError, OccupiedError
from semcal_cli.events import Listener, Progress, ignore
from semcal_cli.files.documents import document_text, read_document
from semcal_cli.files.input_files import hash_file, is_same_file
from semcal_cli.files.output_files import make_folder, write_bytes, write_text
from semcal_cli.files.validation import validate
from semcal_cli.labelling.second_labels import record_second_labels
from semcal_cli.labelling.sides import LabelSide

RECORD = "semcal_label.json"
"""File in a folder of labels that records what they depend on."""
CACHE = ".semcal_labels"
"""Folder beside a drive.yaml for labels that `calibrate --image-model` makes."""
AT_A_TIME = 2
"""Number of frames at a time: the network runs on one while another is read, prepared or written."""
ORIGIN = "from"
"""Key of the record for the origin of a network, on which labels do not depend."""
KEY_LENGTH = 16
"""Number of hexadecimal digits in the names of the cache."""


@dataclass(frozen=True)
class LabelledDrive:
    """Summary of a labelled drive."""

    path: Path
    """The drive.yaml."""
    num_frames: int
    """Number of labelled frames."""
    num_before: int
    """Number of label files that existed before."""
    failures: tuple[str, ...]
    """Messages about the frames that were left out."""


def label_drive(
    drive: Drive,
    sides: Sequence[LabelSide],
    out: Path,
    *,
    indices: Sequence[int] | None = None,
    overwrite: Collection[LabelSide] = (),
    by_content: bool = False,
    on_event: Listener = ignore,
) -> LabelledDrive:
    """Label the frames of a drive, and write a drive with the labels.

    Label files go to folders beside the new drive.yaml. A frame is done when its files are complete, so a run that was
    stopped continues where it left off. Frames that fail are left out.

    Args:
        drive: The drive.
        sides: Sides to label.
        out: Folder of the new drive, or its drive.yaml.
        indices: Frames to label and keep; None for all. Names of label files do not depend on it.
        overwrite: Sides whose existing labels are replaced.
        by_content: Whether label files are named by the content of the labelled file, not by its name.
        on_event: Called with each event.

    Raises:
        InputError: no frame can be labelled, or a folder holds labels of another network or other settings.
    """
    path = output_drive_file(out)
    if is_same_file(path, drive.path):
        raise InputError(f"{path}: found the input drive; choose another name")
    files: dict[str, list[Path]] = {
        side.key: _prepare_folder(drive, side, path.parent, side in overwrite, by_content) for side in sides
    }
    frame_indices = range(len(drive.frames)) if indices is None else indices
    jobs = [(side, index) for index in frame_indices for side in sides]
    pending = [(side, index) for side, index in jobs if not side.is_whole(drive, files[side.key][index])]

    def label(side: LabelSide, index: int) -> None:
        write_bytes(side.label(drive, drive.frames[index]), files[side.key][index])

    failures: dict[int, str] = {}
    with ThreadPoolExecutor(AT_A_TIME) as pool:
        futures = [pool.submit(label, *job) for job in pending]
        try:
            for count, ((_, index), future) in enumerate(zip(pending, futures, strict=True)):
                on_event(Progress("labelling", count, len(pending)))
                try:
                    future.result()
                except InputError as error:
                    failures.setdefault(index, str(error))
        finally:
            pool.shutdown(cancel_futures=True)
    labelled_indices = [index for index in frame_indices if index not in failures]
    if not labelled_indices:
        raise InputError(next(iter(failures.values())))
    document = _document(drive, sides, path, labelled_indices, files)
    validate(Drive, document, path)
    write_text(document_text(document, "yaml"), path)
    return LabelledDrive(path, len(labelled_indices), len(jobs) - len(pending), tuple(failures.values()))


def label_beside(
    drive: Drive, sides: Sequence[LabelSide], on_event: Listener = ignore
) -> tuple[Path, SecondLabels | None]:
    """Label the images of a drive with one network or two, into a cache beside the drive.

    The cache is keyed by the models, their settings and the content of the images.

    Returns:
        The drive.yaml with the labels of the first network, and how far the second differs; None without a second.

    Raises:
        InputError: an image cannot be labelled, or the cache cannot be written.
    """
    folders = [
        _cache_key({"settings": side.settings, "classes": side.classes, "ignore": side.ignore})
        for side in sides
    ]
    # Other frames, another camera or another second network make another drive, so that a result's drive stays
    # what it was.
    name = f"{drive.path.stem}_{_cache_key([drive.model_dump(mode='json'), *folders[1:]])}.yaml"
    paths = [drive.root / CACHE / folder / name for folder in folders]
    for side, path in zip(sides, paths, strict=True):
        make_folder(path.parent, drive.root)
        labelled_drive = label_drive(drive, [side], path, by_content=True, on_event=on_event)
        if labelled_drive.failures:
            raise InputError(
                f"{len(labelled_drive.failures)} of {len(drive.frames)} images failed; {labelled_drive.failures[0]}"
            )
    return paths[0], record_second_labels(*paths) if len(paths) > 1 else None


def _cache_key(content: object) -> str:
    return hashlib.sha256(_record_text(content).encode()).hexdigest()[:KEY_LENGTH]


def _record_text(settings: object) -> str:
    return json.dumps(settings, indent=2, sort_keys=True) + "\n"


def _prepare_folder(drive: Drive, side: LabelSide, root: Path, force: bool, by_content: bool) -> list[Path]:
    """Make the folder of the labels, check its record, and name the label file of each frame."""
    folder = root / (side.folder or side.key)
    make_folder(folder, root)
    record, settings = folder / RECORD, dict(side.settings)
    if side.key == "point_labels" and any(drive.origin_m):
        settings["origin_m"] = list(drive.origin_m)
    if side.key == "point_labels" and drive.lidar is not None and drive.lidar.own_points is not None:
        settings["own_points"] = drive.lidar.own_points.model_dump(mode="json")
    if not by_content:
        # The same name may mean another file in another drive.
        sources = [getattr(frame, side.source) for frame in drive.frames]
        settings["sources"] = _cache_key([str(drive.resolve(source)) for source in sources if source])
    if not record.exists():
        if any(folder.iterdir()):
            raise InputError(f"{folder}: found files that `semcal label` did not write; choose another -o")
    elif not force and {**read_document(record), ORIGIN: None} != {
        **json.loads(_record_text(settings)),
        ORIGIN: None,
    }:
        raise OccupiedError(f"{folder}: found labels of another model, drive or settings")
    files = [folder / f"{name}{side.suffix}" for name in _label_names(drive, side, by_content)]
    for file in files if force else ():
        # A forced run that is stopped leaves no old labels.
        file.unlink(missing_ok=True)
    write_text(_record_text(settings | ({ORIGIN: side.origin} if side.origin else {})), record)
    return files


def _label_names(drive: Drive, side: LabelSide, by_content: bool) -> list[str]:
    """Name the labels of each frame after the labelled file, or after its content."""
    if by_content:
        files = [drive.file_of(frame, side.source, "an image") for frame in drive.frames]
        return [hash_file(file)[:KEY_LENGTH] for file in files]
    stems = [Path(getattr(frame, side.source) or "").name.split(".")[0] for frame in drive.frames]
    if len(set(stems)) == len(stems) and all(stems):
        return stems
    return [f"{index:06d}" for index in range(len(stems))]


def _document(
    drive: Drive,
    sides: Sequence[LabelSide],
    path: Path,
    indices: Sequence[int],
    files: Mapping[str, Sequence[Path]],
) -> dict[str, Any]:
    """Make the document of the labelled drive, with file names relative to it."""

    def relative(name: str) -> str:
        return os.path.relpath(drive.resolve(name), path.parent)

    # A clock that nobody stated is not stated by a copy.
    unstated = {"time_offset_sigma_s"} - drive.model_fields_set
    document: dict[str, Any] = drive.model_dump(mode="json", exclude_none=True, exclude=unstated)
    frames = [document["frames"][index] for index in indices]
    for frame, index in zip(frames, indices, strict=True):
        frame |= {key: relative(frame[key]) for key in FILES if key in frame}
        frame |= {key: os.path.relpath(str(names[index]), path.parent) for key, names in files.items()}
    parts: dict[str, Any] = {key: document.pop(key, {}) for key in ("ignore", "classes")}
    networks = document.pop("networks", {})
    for side in sides:
        name = "image" if side.key == "image_labels" else "points"
        parts["classes"][name] = {class_name: list(ids) for class_name, ids in side.classes.items()}
        parts["ignore"][name] = list(side.ignore)
        networks.pop(name, None)
        if name == "image":
            document.pop("palette", None)
            networks.pop("second", None)
        if side.network is not None:
            networks[name] = side.network.model_dump(mode="json", exclude_none=True)
    if networks:
        document["networks"] = networks
    entries = {key: {name: value for name, value in part.items() if value} for key, part in parts.items()}
    document |= {"frames": frames} | {key: part for key, part in entries.items() if part}
    if "poses" in document.get("motion", {}):
        document["motion"]["poses"] = relative(document["motion"]["poses"])
    if isinstance(mask := drive.camera.mask, str):
        document["camera"]["mask"] = relative(mask)
    return document
