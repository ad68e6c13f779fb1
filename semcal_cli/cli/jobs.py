"""The calibrations of several cameras, one after another."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

from semcal_cli.errors import SemcalError

if TYPE_CHECKING:
    from semcal_cli.cli.outputs import Outputs
    from semcal_cli.cli.terminal import Terminal
    from semcal_cli.result.calibration_document import CalibrationDocument


class Job(NamedTuple):
    """The calibration of one camera of a rig."""

    name: str
    run: Callable[..., CalibrationDocument]
    """Calibrates, and reports its progress to `on_event`."""
    outputs: Outputs
    terminal: Terminal


def calibrate_each(
    jobs: Sequence[Job], num_threads: int | None
) -> tuple[dict[str, CalibrationDocument], dict[str, str]]:
    """Run jobs one after another, and write and show the result of each.

    Returns:
        The calibrations that succeeded, and the errors of the others, by name.
    """
    from semcal_cli.cli.tables import labelled

    calibrations: dict[str, CalibrationDocument] = {}
    failures: dict[str, str] = {}
    for name, run, outputs, terminal in jobs:
        terminal.print(f"[{name}]")
        try:
            with terminal:
                calibration = run(on_event=terminal.on_event)
            outputs.write(calibration, terminal, num_threads)
            calibrations[name] = calibration
        except SemcalError as error:
            failures[name] = str(error)
            terminal.print(labelled("failed", failures[name]))
    return calibrations, failures


def failure_sentence(failures: Mapping[str, str], count: int, *, of_lidars: bool) -> str:
    """Describe how many cameras failed, or calibrations of them with several LiDARs, and why the first one did."""
    name, reason = next(iter(failures.items()))
    return f"{len(failures)} of {count} {'calibrations' if of_lidars else 'cameras'} failed; {name}: {reason}"
