"""Phrases of error messages: the value that was found, and the one that was needed."""

import difflib
from collections.abc import Iterable

MAX_LISTED = 8
MAX_LISTED_LENGTH = 40


def printable(text: str) -> str:
    """Escape what a terminal would not show as letters: names and values of files may hold any characters."""
    if text.isprintable():
        return text
    return "".join(each if each.isprintable() else ascii(each)[1:-1] for each in text)


def mismatch(found: object, needed: object) -> ValueError:
    """Make the error that a validator raises for a wrong value."""
    return ValueError(f"found {found}, needed {needed}")


def describe(value: object) -> str:
    """Describe a value of a document in a few words on one line."""
    match value:
        case None:
            return "nothing"
        case dict():
            return "a mapping"
        case list() | tuple():
            return f"a list of {len(value)}"
        case bool():
            return str(value).lower()
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def one_of(wanted: str, known: Iterable[str]) -> str:
    """List the known names; the nearest to the wanted one first, if there are many."""
    names = list(known)
    if not names:
        return "one, but there is none"
    if len(names) > MAX_LISTED:
        near = difflib.get_close_matches(wanted, names, n=MAX_LISTED, cutoff=0.0)
        return f"one of {len(names)}, nearest: {', '.join(map(_cut, near))}"
    return f"one of: {', '.join(map(_cut, names))}" if len(names) > 1 else _cut(names[0])


def listed(names: Iterable[object]) -> str:
    """List the first names of those found in a file."""
    first = [_cut(str(name)) for name in names]
    more = [f"and {len(first) - MAX_LISTED:,} more"] if len(first) > MAX_LISTED else []
    return ", ".join(first[:MAX_LISTED] + more) or "none"


def _cut(name: str) -> str:
    return name if len(name) <= MAX_LISTED_LENGTH else f"{name[: MAX_LISTED_LENGTH - 3]}..."


def os_reason(error: OSError) -> str:
    """Describe in a few words why the operating system refused."""
    return (error.strerror or str(error)).lower()
