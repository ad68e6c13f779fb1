"""What CI systems read of checks: JUnit XML, and annotations of GitHub."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import click

if TYPE_CHECKING:
    from semcal_cli.limits import Check, Verdict

EXIT_CODES: dict[Verdict, int] = {"pass": 0, "fail": 3, "inconclusive": 4}


def check_line(check: Check, width: int = 21) -> str:
    """Write a check for reading."""
    half = "   not known" if check.half_width is None else f"+- {check.half_width:9.4f}"
    return (
        f"{check.name:<{width}}{check.offset:10.4f} {half} {check.unit:<4} "
        f"allowed {check.allowed:<8g}{check.verdict}"
    )


def write_junit(command: str, checks: Sequence[Check], reasons: Iterable[str], path: Path) -> None:
    """Write a test case for each check: a failure fails, what cannot be decided is skipped.

    Raises:
        InputError: the file cannot be written.
    """
    from semcal_cli.documents import write_text

    verdicts = [check.verdict for check in checks]
    suite = ElementTree.Element(
        "testsuite",
        name=f"semcal {command}",
        tests=str(len(verdicts)),
        failures=str(verdicts.count("fail")),
        skipped=str(verdicts.count("inconclusive")),
        errors="0",
    )
    for check in checks:
        case = ElementTree.SubElement(suite, "testcase", classname=f"semcal.{command}", name=check.name)
        kind = {"fail": "failure", "inconclusive": "skipped"}.get(check.verdict)
        if kind is not None:
            message = "; ".join([" ".join(check_line(check).split()), *reasons])
            ElementTree.SubElement(case, kind, message=message)
    ElementTree.indent(suite)
    write_text(
        '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(suite, encoding="unicode") + "\n",
        path,
    )


def annotate(command: str, verdict: Verdict, checks: Iterable[Check], reasons: Iterable[str]) -> None:
    """Put the verdict where GitHub shows it, in a job of its; on stderr, which it reads as well."""
    if os.environ.get("GITHUB_ACTIONS") != "true":
        return
    kind = {"pass": "notice", "fail": "error", "inconclusive": "warning"}[verdict]
    lines = [check.name for check in checks if check.verdict == verdict != "pass"]
    text = "; ".join([verdict, *lines, *reasons])
    for character, code in (("%", "%25"), ("\r", "%0D"), ("\n", "%0A")):
        text = text.replace(character, code)
    click.echo(f"::{kind} title=semcal {command}::{text}", err=True)
