"""How verdicts on transforms are shown: on the terminal, and as cases for CI."""

from __future__ import annotations

from dataclasses import replace

import click

from semcal_cli.checks import precedence
from semcal_cli.cli.ci import Case
from semcal_cli.cli.tables import shown_reasons, verdict_line, wrapped
from semcal_cli.cli.terminal import COLORS, line_console
from semcal_cli.many.rig.rig_verification import RigVerdict, RigVerification
from semcal_cli.pipeline.verdict import AxisVerdict, overall_offsets
from semcal_cli.pipeline.verification import Verification
from semcal_cli.readable import for_people
from semcal_cli.result.uncertainty import CHECK_NAMES


def cases_of(verification: Verification | RigVerification) -> list[Case]:
    """Make the test cases of a verification; those of a rig begin with the name of the transform.

    Where no check is judged, CI counts the transform as a whole.
    """
    if isinstance(verification, RigVerification):
        verifications = verification.verifications.items()
        cases = [
            replace(case, name=f"{name}: {case.name}")
            for name, found in verifications
            for case in cases_of(found)
        ]
        return [*cases, *(Case(name, "failed", reason) for name, reason in verification.failures.items())]
    if verification.is_reasoned:
        return [Case("transform", verification.verdict, "; ".join(verification.reasons))]
    return [Case.of_check(check) for check in verification.checks]


def print_any(verification: Verification | RigVerification, *, verbose: bool) -> None:
    """Print the verdict on a transform, or on those of a rig."""
    if isinstance(verification, RigVerification):
        _print_rig(verification, verbose=verbose)
    else:
        _print_verification(verification, verbose=verbose)


def _print_verification(verification: Verification, *, verbose: bool) -> None:
    """Print the checks of a transform, what speaks against them, and the verdict."""
    for check in verification.checks:
        click.echo(_check_line(check, verification.word(check)))
    reasons = shown_reasons(verification.reasons, verification.topics, verbose=verbose)
    rows = [*(("reason", reason) for reason in reasons), *(("note", note) for note in verification.notes)]
    lines = [line for label, sentence in rows for line in wrapped(label, sentence)]
    if not verification.is_reasoned:
        lines += wrapped("", verification.sentence, indent=0)
    click.echo("\n".join(lines))
    num = precedence.leading(verification.topics).num
    decisive = (
        f"{num} reason{'s' * (num > 1)}, see above"
        if verification.is_reasoned
        else overall_offsets(verification.checks)[0]
    )
    _print_verdict(verification.verdict, decisive)


def _print_rig(rig: RigVerification, *, verbose: bool) -> None:
    """Print the verdict on each transform of a rig, the sensor that explains them, and the verdict on the rig."""
    for name in rig.views:
        click.echo(f"[{name}]")
        if name in rig.failures:
            click.echo("\n".join(wrapped("failed", rig.failures[name])))
        else:
            _print_verification(rig.verifications[name], verbose=verbose)
    click.echo("[rig]")
    for moved in rig.moved_sensors:
        click.echo("\n".join(wrapped("reason", for_people(moved.sentence))))
    _print_verdict(rig.verdict, rig.deciding)


def _print_verdict(verdict: RigVerdict, decisive: str) -> None:
    console = line_console(stderr=False)
    console.print(verdict_line(verdict, decisive), style=COLORS[verdict], markup=False)


def _check_line(check: AxisVerdict, word: str) -> str:
    text, allowed = check.text, f"{check.allowed:g} {check.unit}"
    if text.offset:
        half = f" +- {text.half_width}" if text.half_width else ""
        found = f"{for_people(f'{text.offset:>9}{half}'):<18} {check.unit}"
    else:
        found = "not determined".rjust(19)
    name = CHECK_NAMES.get(check.name, check.name)
    return f"{name:<28}{found:<23}allowed {allowed:<8} {word}"
