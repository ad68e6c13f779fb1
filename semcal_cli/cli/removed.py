"""Commands, options and values that semcal no longer has, and what to use instead."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

import click

BENCHMARK = "run `python tests/benchmarks/{}.py` in the repository"
REMOVED = {
    ("semcal", "evaluate"): "use `semcal compare CALIBRATION REFERENCE`",
    ("verify", "--init-direction"): "it is called --direction, as in `semcal convert`",
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
    **{
        (f"experiment {name}", "--into"): BENCHMARK.format("kept_table")
        for name in ("pairs", "noise", "table")
    },
    **{(f"experiment {name}", "--out"): "it is called --output" for name in ("pairs", "noise", "table")},
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
        instead = REMOVED.get((_command(error.ctx), name))
        if instead is None:
            raise
        raise click.UsageError(f"{name} was removed: {instead}.", error.ctx) from None


def _command(context: click.Context | None) -> str:
    """Name the command of a context with the groups that it is in, or `semcal` itself."""
    names = list[str]()
    while context is not None:
        names.insert(0, str(context.command.name))
        context = context.parent
    return " ".join(names[1:] if len(names) > 1 and names[0] == "semcal" else names)


def _refused(error: click.UsageError) -> str:
    """Name the option or command that click does not know, or the option and its value."""
    if isinstance(error, click.NoSuchOption):
        return error.option_name
    quoted = re.search(r"'([^']*)'", error.message)
    name = quoted[1] if quoted else ""
    if isinstance(error, click.BadParameter) and isinstance(error.param, click.Option):
        return f"{error.param.opts[0]} {name}"
    return name
