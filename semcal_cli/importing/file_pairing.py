"""Pairs of files, by the times in their names if every name has one, else by the names, or by the numbers in them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import datetime, timezone
from pathlib import Path

import numpy as np

from semcal_cli.config.data_suffixes import CLOUD_SUFFIXES
from semcal_cli.errors import InputError, counted
from semcal_cli.formats.node import MAX_STAMP_S

PLAIN_SECONDS = re.compile(r"\d+\.\d+")
SPLIT_SECONDS = re.compile(r"(?<!\d)([1-9]\d{9})([._-])(\d{1,9})(?!\d)")
"""Unix seconds from 2001 on, then their fraction or nanoseconds; 0000000005 is a frame number."""
WHOLE_UNITS = re.compile(r"(?<!\d)([1-9](?:\d{18}|\d{15}|\d{12}|\d{9}))(?!\d)")
"""Unix time from 2001 on, in nanoseconds, microseconds, milliseconds or seconds, by its number of digits."""
DATE = re.compile(
    r"(?<!\d)(?P<date>20\d\d([-_.]?)[01]\d\2[0-3]\d)[-_.T ]?(?P<time>[0-2]\d([-_.:h]?)[0-5]\d[-_.:m]?[0-6]\d)"
    r"[-_.,s]?(?P<fraction>\d{3}|\d{6}|\d{9})(?!\d)"
)
"""Date and time, with milliseconds, microseconds or nanoseconds; whole seconds are too coarse to pair by."""
PADDED = (3, 6, 9)
"""Numbers of digits of milliseconds, microseconds and nanoseconds."""


def stem(path: Path) -> str:
    """Remove the suffix from a file's name; `.pcd.bin` counts as one suffix."""
    suffix = next((suffix for suffix in CLOUD_SUFFIXES if path.name.endswith(suffix)), path.suffix)
    return path.name.removesuffix(suffix)


def stamps_s(files: Sequence[Path]) -> dict[Path, float]:
    """Read the times in the names of one kind of files, in seconds; files without one are left out.

    ROS's seconds and nanoseconds are often joined without leading zeros: 1581624663_98000000 is 1581624663.098. Only
    the names of all files together distinguish this from a fraction.

    Raises:
        InputError: digits after the seconds are neither a fraction nor nanoseconds.
    """
    matches_by_path = {path: SPLIT_SECONDS.findall(stem(path)) for path in files}
    parts = {path: matches[-1] for path, matches in matches_by_path.items() if matches}
    nanoseconds = {mark: _are_nanoseconds(parts, mark) for mark in "._-"}
    stamps = {path: _plain_stamp_s(stem(path)) for path in files}
    for path, (seconds, mark, digits) in parts.items():
        fraction = digits.zfill(9) if nanoseconds[mark] else digits
        stamps[path] = float(f"{seconds}.{fraction}")
    return {path: stamp for path, stamp in stamps.items() if stamp is not None}


def _are_nanoseconds(parts: Mapping[Path, tuple[str, str, str]], mark: str) -> bool:
    """Return whether the digits after the seconds and a mark are nanoseconds without leading zeros, not a fraction."""
    groups = {path: digits for path, (_, between, digits) in parts.items() if between == mark}
    odd = next((path for path, digits in groups.items() if len(digits) not in PADDED), None)
    if odd is None:
        return False
    longest = max(map(len, groups.values()))
    has_leading_zeros = any(len(digits) > 1 and digits.startswith("0") for digits in groups.values())
    if mark == ".":  # a fraction after a decimal point may have any length, but nine digits are ROS's
        return longest == 9 and not has_leading_zeros
    if longest <= 6 or has_leading_zeros:
        raise InputError(
            f"{odd}: found {counted(len(groups[odd]), 'digit')} after the seconds, needed 3, 6 or 9 in every name, or "
            "nanoseconds without leading zeros"
        )
    return True


def _plain_stamp_s(name: str) -> float | None:
    """Read a name that is a decimal number, a date with a time of day, or the last whole Unix time in it; seconds."""
    if PLAIN_SECONDS.fullmatch(name):
        return stamp if (stamp := float(name)) <= MAX_STAMP_S else None
    if (date := DATE.search(name)) is not None:
        day_time = re.sub(r"\D", "", date["date"] + date["time"])
        with suppress(ValueError):  # no such day or hour
            whole = datetime.strptime(day_time, "%Y%m%d%H%M%S").replace(tzinfo=timezone.utc)
            return whole.timestamp() + float(f"0.{date['fraction']}")
    if digits := WHOLE_UNITS.findall(name):
        return int(digits[-1]) / 10.0 ** (len(digits[-1]) - 10)
    return None


def by_time(*sides: Sequence[Path]) -> bool:
    """Return whether every name holds a time."""
    return all(len(stamps_s(side)) == len(set(side)) for side in sides)


def pairs(clouds: Sequence[Path], others: Sequence[Path], max_gap_s: float) -> dict[Path, Path]:
    """Find the file that belongs to each cloud; no file is used twice.

    By time, two files belong together if each is the nearest to the other, within `max_gap_s`. Where no names are the
    same, the numbers in them are compared: lidar_000012 and cam_12 belong together.

    Args:
        clouds: Files of point clouds.
        others: Files of another kind.
        max_gap_s: Largest time between two files of a pair, in seconds.

    Raises:
        InputError: two files of one kind have the same name, or a time in a name is ambiguous.
    """
    if not by_time(clouds, others):
        for key in (_by_name, _by_number):
            other_by_key = key(others)
            paired = {
                cloud: other_by_key[name] for name, cloud in key(clouds).items() if name in other_by_key
            }
            if paired:
                break
        return paired
    cloud_stamps, other_stamps = (
        np.array([stamps[path] for path in side])
        for side, stamps in ((clouds, stamps_s(clouds)), (others, stamps_s(others)))
    )
    nearest_other = _nearest(cloud_stamps, other_stamps)
    nearest_cloud = _nearest(other_stamps, cloud_stamps)
    return {
        clouds[i]: others[j]
        for i, j in enumerate(nearest_other)
        if nearest_cloud[j] == i and abs(cloud_stamps[i] - other_stamps[j]) <= max_gap_s
    }


def _nearest(stamps: np.ndarray, among: np.ndarray) -> list[int]:
    """Find the index of the nearest of `among` for each stamp, the earlier one of two that are equally near."""
    order = np.argsort(among, kind="stable")
    after = np.clip(np.searchsorted(among[order], stamps), 0, len(among) - 1)
    before = np.maximum(after - 1, 0)
    earlier = np.abs(among[order[before]] - stamps) <= np.abs(among[order[after]] - stamps)
    return [int(index) for index in order[np.where(earlier, before, after)]]


def _by_number(files: Sequence[Path]) -> dict[str, Path]:
    """Map the number in each name, the last or the first one that is different in all names; empty without one."""
    numbers = [[str(int(digits)) for digits in re.findall(r"\d+", stem(path))] for path in files]
    for place in (-1, 0) if all(numbers) else ():
        file_by_number = {in_name[place]: path for in_name, path in zip(numbers, files, strict=True)}
        if len(file_by_number) == len(files):
            return file_by_number
    return {}


def _by_name(files: Sequence[Path]) -> dict[str, Path]:
    file_by_name: dict[str, Path] = {}
    for path in files:
        other = file_by_name.setdefault(stem(path), path)
        if other != path:
            raise InputError(
                f"{path}: found the same name as {other}, expected a distinct name for each frame"
            )
    return file_by_name
