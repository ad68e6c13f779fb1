"""Ids of points and pixels: those without information, the classes that they are merged into, and their colours."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, field_validator

from semcal_cli.files.validation import StrictModel, check_distinct, length

Id = Annotated[int, Field(ge=0, le=0xFFFF)]
Ids = Annotated[tuple[Id, ...], length(0)]
ColorValue = Annotated[int, Field(ge=0, le=255)]
Color = Annotated[tuple[ColorValue, ...], length(3, 3)]


class Ignore(StrictModel):
    """Ids that carry no information."""

    points: Ids = ()
    """Ids of points that carry no information."""
    image: Ids = ()
    """Ids of pixels that carry no information."""


class Classes(StrictModel):
    """Names of classes and the raw ids merged into each. Other ids are ignored; a side without names keeps its ids."""

    points: dict[str, Ids] = {}
    """Raw ids of points for each class name."""
    image: dict[str, Ids] = {}
    """Raw ids of pixels for each class name."""

    @field_validator("points", "image")
    @classmethod
    def _check_ids(cls, side: dict[str, tuple[int, ...]]) -> dict[str, tuple[int, ...]]:
        check_distinct({name: [f"id {value}" for value in ids] for name, ids in side.items()})
        return side
