"""Disagreement between the image labels of two networks, recorded in the labelled drive."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import numpy.typing as npt

from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.networks import LabelNetworks, SecondLabels
from semcal_cli.files.documents import document_text, read_document
from semcal_cli.files.output_files import write_text
from semcal_cli.observations.reading import read_thumbnails

COLUMNS, ROWS = 480, 270
"""Grid of pixels compared in each image, so that a long drive fits into memory."""


def second_file(path: Path) -> Path:
    """Name the drive.yaml with the labels of the second network, beside that of the first."""
    return path.with_stem(f"{path.stem}_2")


def record_second_labels(path: Path, second: Path) -> SecondLabels:
    """Record in a labelled drive the drive with the labels of a second network, and how far the two differ.

    Raises:
        InputError: labels cannot be read.
    """
    share = disagreement(read_drive(path), read_drive(second))
    second_labels = SecondLabels(drive=os.path.relpath(second, path.parent), disagreement=share)
    document = read_document(path)
    networks = LabelNetworks.model_validate(document.get("networks", {}))
    labelled_networks = networks.model_copy(update={"second": second_labels})
    document["networks"] = labelled_networks.model_dump(mode="json", exclude_none=True)
    write_text(document_text(document, "yaml"), path)
    return second_labels


def disagreement(first: Drive, second: Drive) -> float | None:
    """Compute the share of pixels to which two drives of the same images give different classes.

    Classes are compared by name if both drives have the same names. Otherwise each class of the drive that shows more
    classes is matched to the class of the other that it overlaps most.

    Returns:
        The share among pixels that have a class in both drives, to four digits; None if there are none.
    """
    common = {frame.points for frame in first.frames} & {frame.points for frame in second.frames}
    sides = []
    for drive in (first, second):
        frames = tuple(frame for frame in drive.frames if frame.points in common)
        sides.append(_classes(drive.model_copy(update={"frames": frames})))
    (a, names_a), (b, names_b) = sides
    is_classified = (a >= 0) & (b >= 0)
    if not is_classified.any():
        return None
    shape = len(names_a), len(names_b)
    pairs = np.ravel_multi_index((a[is_classified], b[is_classified]), shape)
    counts = np.bincount(pairs, minlength=shape[0] * shape[1]).reshape(shape)
    if set(names_a) == set(names_b):
        same = sum(int(counts[place, names_b.index(name)]) for place, name in enumerate(names_a))
    else:
        is_finer = counts.any(axis=1).sum() >= counts.any(axis=0).sum()
        same = int(counts.max(axis=1 if is_finer else 0).sum())
    return round(1.0 - same / int(counts.sum()), 4)


def _classes(drive: Drive) -> tuple[npt.NDArray[np.int64], list[str]]:
    """Read the class of each compared pixel, as an index into the names; -1 where a pixel has none."""
    ids = read_thumbnails(drive, COLUMNS, ROWS).astype(np.int64)
    names = drive.classes.image if drive.classes is not None else {}
    ids_by_name = names or {str(value): (value,) for value in np.unique(ids).tolist()}
    indices = np.full(1 << 16, -1, np.int64)
    for index, values in enumerate(ids_by_name.values()):
        indices[list(values)] = index
    indices[list(drive.ignore.image)] = -1
    return indices[ids], list(ids_by_name)
