"""How verdicts on transforms are shown: on the terminal, and as cases for CI."""

from __future__ import annotations

from dataclasses import replace

import click

from semcal_cli.checks import precedence
from semcal_cli.cli.ci import Case
from semcal_cli.cli.tables import shown_reasons, verdict_line, wrapped
from semcal_cli.cli.terminal import COLORS, make_console
from semcal_cli.errors import counted, listed
from semcal_cli.many.rig.rig_verification import RigVerification
from semcal_cli.pipeline.verdict import AxisVerdict, Verdict, overall_offsets
from semcal_cli.pipeline.verification import Verification
from semcal_cli.readable import for_people
from semcal_cli.result.uncertainty import CHECK_NAMES


def cases_of(verification: Verification | RigVerification) -> list[Case]:
    """Make the test cases of a verification; those of a rig begin with the name of the camera.

    Where no check is judged, CI counts the camera as a whole. One that could not be verified counts as failed.
    """
    if isinstance(verification, RigVerification):
        of_cameras = verification.cameras.items()
        cases = [
            replace(case, name=f"{name}: {case.name}")
            for name, camera in of_cameras
            for case in cases_of(camera)
        ]
        return [*cases, *(Case(name, "fail", reason) for name, reason in verification.failures.items())]
    if verification.is_reasoned:
        return [Case("transform", verification.verdict, "; ".join(verification.reasons))]
    return [Case.of_check(check) for check in verification.checks]


def print_verification(verification: Verification, *, verbose: bool) -> None:
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


def print_rig_verification(rig: RigVerification, *, verbose: bool) -> None:
    """Print the verdict on each camera of a rig, what explains them together, and the verdict on the rig."""
    for name, camera in rig.cameras.items():
        click.echo(f"[{name}]")
        print_verification(camera, verbose=verbose)
    click.echo("[rig]")
    for displacement in rig.displacements:
        click.echo("\n".join(wrapped("reason", displacement.sentence)))
    names, of_all = rig.deciding, counted(len(rig.lidars), "camera")
    _print_verdict(rig.verdict, of_all if len(names) == len(rig.lidars) else f"{listed(names)}, of {of_all}")


def _print_verdict(verdict: Verdict, decisive: str) -> None:
    console = make_console(stderr=False)
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
