"""Checks of documents: strict pydantic models, and error messages of one line."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeAlias, TypeVar

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import ErrorDetails

from semcal_cli.errors import InputError, describe, mismatch, nearest
from semcal_cli.geometry.poses import check_rigid, orthonormal

MAX_TRANSLATION_M = 1e6
"""Maximum translation: no LiDAR is farther from its camera, whatever the unit."""


NEWEST_VERSION = 1
"""Newest version of each of semcal's documents, stated by a key such as `semcal_drive`. A version changes where an
older semcal would misread the document. Each semcal reads all older versions, and refuses newer ones by name."""
MAX_ENTRIES = 500_000
"""Maximum number of entries of a mapping and the mappings in it: pydantic keeps a kilobyte for each wrong one."""


class StrictModel(BaseModel):
    """Immutable model without conversions, except of whole numbers to floats; unknown keys are errors."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _name_nearest_key(cls, document: object) -> object:
        known_keys = [str(field.validation_alias or name) for name, field in cls.model_fields.items()]
        entries = document if isinstance(document, dict) else {}
        check_not_newer(entries, known_keys)
        for key, value in entries.items():
            if key not in known_keys:
                (known_key,) = nearest(str(key), known_keys, 1)
                raise ValueError(f"unknown key {describe(key)}; the nearest known key is {known_key!r}")
            if isinstance(value, dict):
                inner = sum(len(entry) for entry in value.values() if isinstance(entry, dict))
                if (num_entries := len(value) + inner) > MAX_ENTRIES:
                    problem = mismatch(f"a mapping of {num_entries:,} entries", f"at most {MAX_ENTRIES:,}")
                    raise ValueError(f"{key}: {problem}")
        return document


Model = TypeVar("Model", bound=BaseModel)


def validate(
    model: type[Model], document: object, path: Path | str, names: Mapping[str, str] | None = None
) -> Model:
    """Check a document that was read from `path`.

    Args:
        model: What the document must be.
        document: The document.
        path: Its file.
        names: What the file itself calls keys of the document, where that differs, for messages.

    Raises:
        InputError: the document is wrong; the message is `FILE: KEY: found X, expected Y`.
    """
    try:
        return model.model_validate(document)
    except ValidationError as error:
        raise input_error(error, str(path), names) from None


def input_error(error: ValidationError, where: str, names: Mapping[str, str] | None = None) -> InputError:
    """Make one line of the first problem that pydantic found in `where`, a file or a class, by its names of keys."""
    first = error.errors()[0]
    return InputError(": ".join(filter(None, (where, _key(first, names or {}), _complaint(first)))))


def check_distinct(names: Mapping[str, Iterable[object]]) -> None:
    """Check that no value is listed under two names.

    Raises:
        ValueError: a value is listed under two names.
    """
    owners: dict[object, str] = {}
    for name, values in names.items():
        for value in values:
            owner = owners.setdefault(value, name)
            if owner != name:
                raise mismatch(f"{value} under {describe(owner)} and {describe(name)}", "it under one name")


def check_not_newer(document: Mapping[Any, Any], known_keys: Iterable[str]) -> None:
    """Refuse a newer version before other keys are checked, some of which may be unknown.

    Args:
        document: The document.
        known_keys: Keys that it may have, including that of its version.

    Raises:
        ValueError: a newer semcal wrote the document.
    """
    for key in (key for key in known_keys if key.startswith("semcal_")):
        version = document.get(key)
        if type(version) is int and version > NEWEST_VERSION:
            newer = f"{describe(version)}, which a newer semcal wrote"
            raise ValueError(f"{key}: {mismatch(newer, NEWEST_VERSION)}")


def _check_version(version: int) -> int:
    if version != NEWEST_VERSION:
        raise mismatch(describe(version), NEWEST_VERSION)
    return version


def _check_file_name(name: str) -> str:
    if not name or "\0" in name:
        raise mismatch(describe(name), "a file name")
    return name


def _check_rigid(rows: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    T = np.array(rows)
    check_rigid(T)
    if (farthest := np.abs(T[:3, 3]).max()) > MAX_TRANSLATION_M:
        raise mismatch(f"a translation of {farthest:g}", f"at most {MAX_TRANSLATION_M:g} m")
    return rows


def _orthonormal(rows: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, orthonormal(np.array(rows)).tolist()))


def length(minimum: int, maximum: int | None = None) -> Any:
    """Annotate a tuple that is read from a list, the only sequence of YAML and JSON, with limits on its length.

    Only the first wrong item is reported, so that errors of millions of others are not kept.
    """
    return Field(strict=False, min_length=minimum, max_length=maximum, fail_fast=True)


Version = Annotated[int, AfterValidator(_check_version), Field(json_schema_extra={"const": NEWEST_VERSION})]
FileName = Annotated[str, AfterValidator(_check_file_name), Field(json_schema_extra={"minLength": 1})]
Vector3: TypeAlias = Annotated[tuple[float, ...], length(3, 3)]
Vector4: TypeAlias = Annotated[tuple[float, ...], length(4, 4)]
StatedTransform: TypeAlias = Annotated[tuple[Vector4, ...], length(4, 4), AfterValidator(_check_rigid)]
"""Rigid transform as a file states it, with its rounding."""
RigidTransform: TypeAlias = Annotated[StatedTransform, AfterValidator(_orthonormal)]
"""Rigid transform whose rounding is removed; one that semcal wrote is read back to the last bit."""

Share = Annotated[float, Field(ge=0.0, le=1.0)]
Count = Annotated[int, Field(ge=0)]
Width: TypeAlias = Annotated[float, Field(ge=0.0, le=1e100)]
"""Non-negative size of an offset, small enough not to overflow in other units."""
Figure: TypeAlias = Annotated[float, Field(ge=-1e100, le=1e100)]
"""Figure of any sign, small enough not to overflow when squared."""
Widths: TypeAlias = Annotated[tuple[Width, ...], length(3, 3)]

_NEEDED = {
    "missing": "a value",
    "bool_type": "true or false",
    "int_type": "a whole number",
    "float_type": "a number",
    "finite_number": "a finite number",
    "string_type": "text",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "tuple_type": "a list",
    "none_required": "null",
    "string_too_long": "at most {max_length} characters",
    "too_short": "at least {min_length}",
    "too_long": "at most {max_length}",
    "greater_than": "more than {gt}",
    "greater_than_equal": "at least {ge}",
    "less_than_equal": "at most {le}",
    "literal_error": "{expected}",
    "string_pattern_mismatch": "text that matches {pattern}",
}


def _complaint(error: ErrorDetails) -> str:
    context: dict[str, Any] = error.get("ctx", {})
    if error["type"] == "value_error":
        return str(context["error"])
    description = "nothing" if error["type"] == "missing" else describe(error["input"])
    if error["type"] in ("too_short", "too_long") and isinstance(error["input"], dict):
        description = f"a mapping of {len(error['input'])}"
    if error["loc"] and str(error["loc"][-1]).startswith("semcal_"):
        return f"found {description}, needed {NEWEST_VERSION}"
    return str(mismatch(description, _NEEDED.get(error["type"], error["msg"]).format(**context)))


def _key(error: ErrorDetails, names: Mapping[str, str]) -> str:
    # pydantic marks an error in a key, and one in a form of a value, this way.
    parts = [part for part in error["loc"] if not str(part).startswith("[")]
    first, *others = [key_part(part) for part in parts] or [""]
    key = first.removeprefix(".")
    return "".join([names.get(key, key), *others])


def key_part(part: int | str) -> str:
    """Name a step into a document: `.key`, or the key or the index in brackets."""
    if isinstance(part, str) and part.isidentifier():
        return f".{part}"
    return f"[{describe(part)}]"
