"""The order in which drives were recorded."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Literal, Protocol, TypeAlias, TypeVar

EPOCH_S = 1e9
"""Minimum stamp that counts as seconds since 1970; smaller ones may start anywhere and cannot be compared."""
Order: TypeAlias = Literal["stamp", "name"]
"""What drives are ordered by."""


class DatedDrive(Protocol):
    """A drive that may have a stamp."""

    @property
    def name(self) -> str:
        """Name of the drive."""

    @property
    def stamp(self) -> float | None:
        """Stamp of the first frame in seconds; None if it has none."""


Dated = TypeVar("Dated", bound=DatedDrive)


def has_date(drive: DatedDrive) -> bool:
    """Return whether the stamp of a drive can be compared with those of other drives."""
    return drive.stamp is not None and drive.stamp >= EPOCH_S


def in_order(drives: Iterable[Dated]) -> tuple[list[Dated], Order]:
    """Sort drives by stamp, or by name if their stamps cannot be compared."""
    by_name = sorted(drives, key=lambda drive: _natural_key(drive.name))
    stamps = {drive.stamp for drive in by_name}
    if len(stamps) == 1 or not all(map(has_date, by_name)):
        return by_name, "name"
    return sorted(by_name, key=lambda drive: drive.stamp or 0.0), "stamp"


def _natural_key(name: str) -> tuple[list[tuple[int, str]], str]:
    """Return a sort key that puts 10 after 2."""
    parts = re.split(r"([0-9]+)", name)
    digits = (part.lstrip("0") if index % 2 else part for index, part in enumerate(parts))
    return [(len(part) if index % 2 else 0, part) for index, part in enumerate(digits)], name
