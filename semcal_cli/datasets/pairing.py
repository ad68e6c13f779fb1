"""Pairs of files: by the times in their names where all names hold one, else by the names themselves."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from semcal_cli.datasets.labels import CLOUD_SUFFIXES
from semcal_cli.errors import InputError

PLAIN_SECONDS = re.compile(r"\d+\.\d+")
SPLIT_SECONDS = re.compile(r"(?<!\d)(\d{9,10})[._-](\d{9}|\d{6}|\d{3})(?!\d)")
"""Seconds, then milliseconds, microseconds or nanoseconds."""
WHOLE_UNITS = re.compile(r"(?<!\d)(\d{19}|\d{16}|\d{13}|\d{10})(?!\d)")
"""Unix time in nanoseconds, microseconds, milliseconds or seconds, told by its digits."""


def stem(path: Path) -> str:
    """A file's name without its suffix; of `.pcd.bin` without both."""
    suffix = next((suffix for suffix in CLOUD_SUFFIXES if path.name.endswith(suffix)), path.suffix)
    return path.name.removesuffix(suffix)


def stamp_s(name: str) -> float | None:
    """The time in a file's name, in seconds; None if there is none."""
    if PLAIN_SECONDS.fullmatch(name):
        return float(name)
    if found := SPLIT_SECONDS.findall(name):
        seconds, fraction = found[-1]
        return float(f"{seconds}.{fraction}")
    if found := WHOLE_UNITS.findall(name):
        digits = found[-1]
        return int(digits) / 10.0 ** (len(digits) - 10)
    return None


def by_time(*sides: Sequence[Path]) -> bool:
    """Whether every name holds a time."""
    return all(stamp_s(stem(path)) is not None for side in sides for path in side)


def pairs(clouds: Sequence[Path], others: Sequence[Path], max_gap_s: float) -> dict[Path, Path]:
    """Give each cloud the file that belongs to it; neither is used twice.

    By time, two files belong together if each is the nearest of the other, within `max_gap_s`.

    Raises:
        InputError: two files of one side have the same name.
    """
    if not by_time(clouds, others):
        named = _by_name(others)
        return {cloud: named[name] for name, cloud in _by_name(clouds).items() if name in named}
    cloud_stamps, other_stamps = (
        np.array([stamp_s(stem(p)) for p in side], dtype=float) for side in (clouds, others)
    )
    nearest_other = _nearest(cloud_stamps, other_stamps)
    nearest_cloud = _nearest(other_stamps, cloud_stamps)
    return {
        clouds[i]: others[j]
        for i, j in enumerate(nearest_other)
        if nearest_cloud[j] == i and abs(cloud_stamps[i] - other_stamps[j]) <= max_gap_s
    }


def _nearest(stamps: np.ndarray, among: np.ndarray) -> list[int]:
    """Index of the nearest of `among` for each stamp; the earlier of two."""
    order = np.argsort(among, kind="stable")
    after = np.clip(np.searchsorted(among[order], stamps), 0, len(among) - 1)
    before = np.maximum(after - 1, 0)
    earlier = np.abs(among[order[before]] - stamps) <= np.abs(among[order[after]] - stamps)
    return [int(index) for index in order[np.where(earlier, before, after)]]


def _by_name(files: Sequence[Path]) -> dict[str, Path]:
    named: dict[str, Path] = {}
    for path in files:
        other = named.setdefault(stem(path), path)
        if other != path:
            raise InputError(f"{path}: found the name of {other}, needed names that tell the frames apart")
    return named
