"""Commands, options and values that semcal no longer has, and what to use instead."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

import click

BENCHMARK = "run `python tests/benchmarks/{}.py` in the repository"
REMOVED = {
    ("semcal", "evaluate"): "use `semcal compare CALIBRATION REFERENCE`",
    ("convert", "--into"): "`--to FORMAT` prints the block to paste, and `-o FILE` writes it",
    ("initialize", "--overlay"): "`semcal overlay DRIVE FILE -o DIR` shows the pose",
    (
        "calibrate",
        "--split",
    ): "calibrate a copy of drive.yaml with the `frames` of each part, then use `semcal compare`",
    ("calibrate", "--method soic"): "`semcal experiment pairs` compares with SOIC",
    **{
        ("experiment", name): BENCHMARK.format(name)
        for name in ("accuracy", "speed", "trust", "jointly", "gradient")
    },
}
"""What to use instead, by the command that had it and its name; that of a value follows its option."""


@contextmanager
def explained() -> Iterator[None]:
    """Replace the message of click about what was removed by one that says what to use instead.

    Raises:
        click.UsageError: the command line is wrong.
    """
    try:
        yield
    except click.UsageError as error:
        name = _refused(error)
        command = error.ctx.command.name if error.ctx is not None else None
        instead = REMOVED.get((str(command), name))
        if instead is None:
            raise
        raise click.UsageError(f"{name} was removed: {instead}.", error.ctx) from None


def _refused(error: click.UsageError) -> str:
    """Name the option or command that click does not know, or the option and its value."""
    if isinstance(error, click.NoSuchOption):
        return error.option_name
    quoted = re.search(r"'([^']*)'", error.message)
    name = quoted[1] if quoted else ""
    if isinstance(error, click.BadParameter) and isinstance(error.param, click.Option):
        return f"{error.param.opts[0]} {name}"
    return name
