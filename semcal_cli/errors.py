"""The errors that semcal raises on purpose, the words of their messages, and the checks for optional libraries.

Any other exception that escapes is a bug.
"""

from __future__ import annotations

import difflib
import gc
import json
import math
import re
import shlex
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from itertools import islice
from pathlib import Path

MAX_LISTED = 8
MAX_LISTED_LENGTH = 40
NUM_SHARED = 8
"""Characters before the first that differs that are shown of names that begin alike."""
MAX_COMPARED, MAX_COMPARED_LENGTH = 1000, 64
"""Maximum number of names that are compared with another one, and of their characters: the time grows with the square
of the length, and a file can hold any name."""
_COMPARED = re.compile(r"[-+]?\d|at (most|least)|(more|less) than|fewer|norm|[\[(]")
"""How an expected value begins that a person compares with the found one."""
MAX_MORE_DIGITS = 6
"""Maximum number of digits that are added to tell two numbers apart."""
_PLATFORMS = {"e57": "Linux on x86-64 and on a Mac with Apple silicon"}
"""Where an extra exists that does not exist everywhere: elsewhere pip installs nothing, and reports no error."""


class SemcalError(Exception):
    """Root of the tree, caught once, in the command line. Its text is one line for the user."""

    def __str__(self) -> str:
        """Join the lines, and escape what cannot be printed."""
        return printable(" ".join(super().__str__().splitlines()))


class InputError(SemcalError):
    """A file or an option is wrong, and the user can correct it."""


class MisplacedError(InputError):
    """A file is of the wrong kind, for instance because two arguments are swapped."""


class ChoiceError(InputError):
    """The input holds several things of a kind, of which the user has to choose one by options."""

    def __init__(self, problem: str, expected: str = "", choices: Iterable[tuple[str, ...]] = ()) -> None:
        """Make the error.

        Args:
            problem: What was found.
            expected: The things to choose from, for those who have no command line.
            choices: The words that each of them adds to a command, such as `("--image", "/left/image_raw")`.
        """
        super().__init__(f"{problem}, expected {expected}" if expected else problem)
        self.problem, self.choices = problem, tuple(choices)


class OccupiedError(InputError):
    """The place of an output holds something of the user's, which only --force replaces."""

    def __init__(self, problem: str) -> None:
        """Make the error.

        Args:
            problem: What was found.
        """
        super().__init__(f"{problem}; choose another -o, or --force")
        self.problem = problem


class NoStartError(InputError):
    """The data compare points and pixels only near the right pose, and nothing says where that is."""


class CalibrationError(SemcalError):
    """The data do not determine an answer."""


@contextmanager
def name_in_errors(path: Path) -> Iterator[None]:
    """Name the file in the errors of a stage that does not know it."""
    try:
        yield
    except (InputError, CalibrationError) as error:
        raise type(error)(f"{path}: {error}") from error


def printable(text: str) -> str:
    """Escape unprintable characters, which file names and values in files may contain."""
    if text.isprintable():
        return text
    return "".join(character if character.isprintable() else ascii(character)[1:-1] for character in text)


def mismatch(found: object, expected: object) -> ValueError:
    """Make the error that a validator raises for a wrong value: "needed" stands before what a person compares."""
    word = "needed" if _COMPARED.match(str(expected)) else "expected"
    return ValueError(f"found {found}, {word} {expected}")


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


def counted(count: int, noun: str) -> str:
    """Format a number of things: "1 frame", "2,000 entries"."""
    plural = f"{noun[:-1]}ies" if noun.endswith("y") else f"{noun}es" if noun.endswith("s") else f"{noun}s"
    return f"{count:,} {noun if count == 1 else plural}"


def format_against_limit(value: float, limit: float, digits: int = 0, unit: str = "") -> tuple[str, str]:
    """Format a value and its limit with enough digits to tell them apart.

    Args:
        value: The value.
        limit: The limit, which is written without trailing zeros.
        digits: Minimum number of digits after the decimal point.
        unit: "%" writes fractions as percentages.
    """
    scale = 100.0 if unit == "%" else 1.0
    for places in range(digits, digits + MAX_MORE_DIGITS + 1):
        text, limit_text = f"{scale * value:.{places}f}", f"{scale * limit:.{places}f}"
        is_told = float(text) != float(limit_text)
        if is_told or (value == limit and math.isclose(float(limit_text), scale * limit)):
            break
    short = limit_text.rstrip("0").rstrip(".") if "." in limit_text else limit_text
    return (text if float(text) else text.removeprefix("-")) + unit, short + unit


def one_of(name: str, choices: Iterable[str]) -> str:
    """List the known names; if there are many, the closest ones."""
    names = list(choices)
    if not names:
        return "one, but there is none"
    if len(names) > MAX_LISTED:
        return f"one of {len(names)}, nearest: {', '.join(_short(nearest(name, names, MAX_LISTED)))}"
    return f"one of: {', '.join(_short(names))}" if len(names) > 1 else _cut(names[0])


def nearest(name: str, names: Iterable[str], count: int) -> list[str]:
    """Find the names that are most like another one, the nearest first."""
    by_start = {choice[:MAX_COMPARED_LENGTH]: choice for choice in islice(names, MAX_COMPARED)}
    starts = difflib.get_close_matches(name[:MAX_COMPARED_LENGTH], by_start, n=count, cutoff=0.0)
    return [by_start[start] for start in starts]


def listed(names: Iterable[object]) -> str:
    """List names found in a file, and count those beyond the first `MAX_LISTED`."""
    return ", ".join(first_of(_short([str(name) for name in names]), MAX_LISTED)) or "none"


def shell(*words: object) -> str:
    """Write a command of semcal, quoted for the shell."""
    texts = (_path_word(word) if isinstance(word, Path) else str(word) for word in words)
    return shlex.join(["semcal", *texts])


def _path_word(path: Path) -> str:
    """Write a path as a word of a command, in which a name that begins with a dash would be an option."""
    word = str(path)
    return f"./{word}" if word.startswith("-") and word != "-" else word


def first_of(lines: Sequence[str], max_lines: int) -> list[str]:
    """Keep the first lines; if there are more, another line says how many."""
    more = [f"and {len(lines) - max_lines:,} more"] if len(lines) > max_lines else []
    return [*lines[:max_lines], *more]


def _cut(name: str) -> str:
    return name if len(name) <= MAX_LISTED_LENGTH else f"{name[: MAX_LISTED_LENGTH - 3]}..."


def _short(names: list[str]) -> list[str]:
    """Cut long names at their end, or up to where they differ, if they would be alike."""
    short = [_cut(name) for name in names]
    if len({*short}) == len({*names}):
        return short
    ends = zip(min(names), max(names), strict=False)
    start = next((place for place, (one, other) in enumerate(ends) if one != other), 0)
    return [f"...{_cut(name[max(start - NUM_SHARED, 0) :])}" for name in names]


def reason(error: BaseException) -> str:
    """Describe on one line why another library failed; some of its errors have no text."""
    return " ".join(str(error).split()) or type(error).__name__


def os_reason(error: OSError) -> str:
    """Describe in a few words why a system call failed."""
    return (error.strerror or str(error)).lower()


def is_installed(package: str) -> bool:
    """Return whether a library is installed; it is not imported."""
    with suppress(ImportError):
        return find_spec(package) is not None
    return False


def describe_extra(extra: str) -> str:
    """Name an extra and the command that installs it from where semcal itself came from."""
    platforms = f", which exists only on {_PLATFORMS[extra]}" if extra in _PLATFORMS else ""
    return f"the extra '{extra}'{platforms}: pip install '{_requirement(extra)}'"


def _requirement(extra: str) -> str:
    """Name semcal with an extra as pip does: an index knows no address, and pip notes any other (PEP 610)."""
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        record = distribution("semcal").read_text("direct_url.json")
    except PackageNotFoundError:  # its sources, which nobody installed
        return f".[{extra}]"
    if record is None:
        return f"semcal[{extra}]"
    origin = json.loads(record)
    address, folder = origin["url"], origin.get("subdirectory")
    if (cloned := origin.get("vcs_info")) is not None:
        address = f"{cloned['vcs']}+{address}@{cloned.get('requested_revision', cloned['commit_id'])}"
    return f"semcal[{extra}] @ {address}" + (f"#subdirectory={folder}" if folder else "")


def check_installed(requester: str, package: str, extra: str) -> None:
    """Check that a library is installed, before anything is read.

    Args:
        requester: The option, file or command that needs it.
        package: Its import name.
        extra: Extra of semcal that installs it.

    Raises:
        InputError: it is not installed.
    """
    if not is_installed(package):
        raise InputError(f"{requester}: found no {package}; install {describe_extra(extra)}")


def check_torch(requester: str) -> None:
    """Check that torch, which MINE needs, is installed.

    Raises:
        InputError: it is not installed.
    """
    check_installed(requester, "torch", "mine")


@contextmanager
def torch_import() -> Iterator[None]:
    """Import modules that import torch, without garbage collection: everything that torch creates stays.

    Raises:
        InputError: torch is installed, but cannot be imported, for instance because a system library is missing.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    except (ImportError, OSError) as error:
        message = " ".join(str(error).split())
        raise InputError(
            f"torch: found an installation that cannot be imported ({message}); install {describe_extra('mine')}"
        ) from None
    finally:
        if was_enabled:
            gc.enable()
