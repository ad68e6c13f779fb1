"""The errors that semcal raises on purpose. Anything else that escapes is a bug."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from semcal_cli.messages import printable


class SemcalError(Exception):
    """Root of the tree, caught once, in the command line. Its text is one line for the user."""

    def __str__(self) -> str:
        """Join lines, and escape what cannot be printed: names and values of files may hold any characters."""
        return printable(" ".join(super().__str__().splitlines()))


class InputError(SemcalError):
    """A file or an option is wrong, and the user can mend it."""


class MisplacedError(InputError):
    """A file stands where another kind of file belongs, as of arguments the wrong way round."""


class CalibrationError(SemcalError):
    """The data cannot give an answer."""


@contextmanager
def about(path: Path) -> Iterator[None]:
    """Name the file of the data in errors of a stage, which does not know it."""
    try:
        yield
    except (InputError, CalibrationError) as error:
        raise type(error)(f"{path}: {error}") from error
