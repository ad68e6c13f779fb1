"""Class tables of data sets: YAML files with names, ids, colours and their source; a user's own may have ids alone."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Annotated

from pydantic import Field, field_validator, model_validator

from semcal_cli.drive.class_ids import Color, Ids
from semcal_cli.errors import InputError, counted, describe
from semcal_cli.files.documents import read_document
from semcal_cli.files.validation import StrictModel, check_distinct, validate

FOLDER = Path(__file__).parent
MAX_RED = 255
MAX_NAMES = 65_536
"""Largest number of names in a table: there are no more ids."""


class NamedClass(StrictModel):
    """A class that points or pixels may have."""

    ids: Ids
    """Raw ids that are merged into the class."""
    color: Color | None = None
    """Red, green and blue of the class in colour-coded label images."""

    @model_validator(mode="before")
    @classmethod
    def _take_ids_alone(cls, document: object) -> object:
        return document if isinstance(document, dict) else {"ids": document}


class Ontology(StrictModel):
    """The classes of a data set's labels."""

    ignore: Ids = ()
    """Ids that carry no information. Ids that no class lists are ignored, too."""
    classes: Annotated[dict[str, NamedClass], Field(min_length=1, max_length=MAX_NAMES)]
    """Classes by name; a list of ids stands for a class without a colour."""

    @field_validator("classes")
    @classmethod
    def _check_ids(cls, classes: dict[str, NamedClass]) -> dict[str, NamedClass]:
        for name, entry in classes.items():
            if not name.strip() or not name.isprintable():
                raise ValueError(f"found {describe(name)}, expected a printable name on one line")
            if not entry.ids:
                raise ValueError(f"{name}: found no ids, needed at least one")
        check_distinct({name: [f"id {value}" for value in entry.ids] for name, entry in classes.items()})
        check_distinct({name: [f"color {list(c.color)}"] for name, c in classes.items() if c.color})
        return classes

    def ids(self) -> dict[str, list[int]]:
        """List the raw ids of each name, as in the `classes:` block of a drive."""
        return {name: list(entry.ids) for name, entry in self.classes.items()}

    def palette(self) -> dict[str, list[int]]:
        """List the colour of each name, as in the `palette:` block of a drive; empty without colours."""
        return {name: list(entry.color) for name, entry in self.classes.items() if entry.color}

    def in_red(self) -> Ontology:
        """Make the table for label images whose red channel is the id and whose green and blue are 0.

        Raises:
            InputError: a class has several ids, which would be several colours, or an id above 255.
        """
        classes = {}
        for name, entry in self.classes.items():
            if len(entry.ids) != 1:
                raise InputError(
                    f"class {name!r}: found {counted(len(entry.ids), 'id')}, expected one: "
                    "the label images are colours, and a palette has one colour per class"
                )
            if entry.ids[0] > MAX_RED:
                raise InputError(
                    f"class {name!r}: found id {entry.ids[0]}, needed at most {MAX_RED}, the largest value of red"
                )
            classes[name] = NamedClass(ids=entry.ids, color=(entry.ids[0], 0, 0))
        return Ontology(ignore=self.ignore, classes=classes)


def ontology_names() -> list[str]:
    """List the names of the tables in the package."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def read_ontology(name: str) -> Ontology:
    """Read a table by its name in the package, or by its path.

    A file has the layout of the tables in the package, or names with their ids alone, as `road: [7]`.

    Raises:
        InputError: the table does not exist, or is wrong.
    """
    is_shipped = name in ontology_names()
    path = FOLDER / f"{name}.yaml" if is_shipped else Path(name)
    if not is_shipped and not path.suffix and not _is_there(path):
        raise InputError(
            f"found class table {name!r}, expected a file or one of: {', '.join(ontology_names())}"
        )
    document = read_document(path)
    if isinstance(document.get("classes"), dict):
        return validate(Ontology, document, path)
    if "ignore" in document:
        raise InputError(
            f"{path}: ignore: found next to the class names, expected the names under a key 'classes'; "
            "ids that no class lists are ignored anyway"
        )
    return validate(Ontology, {"classes": document}, path)


def _is_there(path: Path) -> bool:
    with suppress(OSError):
        return path.exists()
    return False
