"""The names of cues."""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

from semcal_cli.errors import InputError, one_of
from semcal_cli.plugins import Plugins

BuiltInCue: TypeAlias = Literal["labels", "segments", "edges", "intensity", "features", "auto"]
"""The names of semcal's own cues, each of which is a module of `observations/cues`, and `auto`."""
CueName: TypeAlias = BuiltInCue | str
"""What points and pixels are compared by: a cue of semcal or of a plugin; auto stands for the best cues that the files
of a drive allow."""

LABELS: tuple[CueName, ...] = ("labels",)
AUTO: tuple[CueName, ...] = ("auto",)
PLUGINS = Plugins("semcal.cues", get_args(BuiltInCue))
"""Cues of other installed packages."""


def cue_names() -> tuple[str, ...]:
    """List the names of all cues."""
    return (*get_args(BuiltInCue), *PLUGINS.names)


def check_cues(cues: tuple[CueName, ...]) -> None:
    """Check the cues that a program passes.

    Raises:
        InputError: they are not a tuple of known names, each given once, or auto is not alone.
    """
    if not isinstance(cues, tuple) or not cues or len({*map(str, cues)}) < len(cues):
        raise InputError(f"cues: found {cues!r}, expected a tuple of different cues")
    if "auto" in cues and len(cues) > 1:
        raise InputError(f"cues: found {cues!r}, expected auto alone")
    for cue in cues:
        if cue not in PLUGINS.own_names and cue not in PLUGINS.names:
            raise InputError(f"cues: found {cue!r}, expected {one_of(str(cue), cue_names())}")
