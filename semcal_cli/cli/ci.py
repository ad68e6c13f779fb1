"""Checks for CI systems: JUnit XML, and GitHub annotations."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from semcal_cli.assessment.limits import Check, Verdict

NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 does not allow."""

EXIT_CODES: dict[Verdict, int] = {"pass": 0, "fail": 3, "inconclusive": 4}


def check_line(check: Check, width: int = 21) -> str:
    """Format a check as one line of text."""
    half = "   not known" if check.half_width is None else f"+- {check.half_width:9.4f}"
    return (
        f"{check.name:<{width}}{check.offset:10.4f} {half} {check.unit:<4} "
        f"allowed {check.allowed:<8g}{check.verdict}"
    )


@dataclass(frozen=True)
class Case:
    """A test case for CI, made from one check."""

    name: str
    verdict: Verdict
    message: str

    @classmethod
    def of_check(cls, check: Check, reasons: Sequence[str] = ()) -> Case:
        """Make a test case from a check, with the reasons for its verdict."""
        return cls(check.name, check.verdict, "; ".join([" ".join(check_line(check).split()), *reasons]))


def junit_xml(command: str, cases: Sequence[Case]) -> str:
    """Make JUnit XML with a test case for each check: a failed check fails, an inconclusive one is skipped."""
    verdicts = [case.verdict for case in cases]
    from xml.etree import ElementTree

    suite = ElementTree.Element(
        "testsuite",
        name=f"semcal {command}",
        tests=str(len(verdicts)),
        failures=str(verdicts.count("fail")),
        skipped=str(verdicts.count("inconclusive")),
        errors="0",
    )
    for case in cases:
        name = NO_XML.sub("?", case.name)
        element = ElementTree.SubElement(suite, "testcase", classname=f"semcal.{command}", name=name)
        kind = {"fail": "failure", "inconclusive": "skipped"}.get(case.verdict)
        if kind is not None:
            ElementTree.SubElement(element, kind, message=NO_XML.sub("?", case.message))
    ElementTree.indent(suite)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(suite, encoding="unicode") + "\n"


def annotate(command: str, verdict: Verdict, names: Iterable[str], reasons: Iterable[str]) -> None:
    """Print the verdict with its names as an annotation, if this is a GitHub job; GitHub reads stderr as well."""
    if os.environ.get("GITHUB_ACTIONS") != "true":
        return
    kind = {"pass": "notice", "fail": "error", "inconclusive": "warning"}[verdict]
    text = "; ".join([verdict, *names, *reasons])
    for character, code in (("%", "%25"), ("\r", "%0D"), ("\n", "%0A")):
        text = text.replace(character, code)
    click.echo(f"::{kind} title=semcal {command}::{text}", err=True)


def of_verdict(verdict: Verdict, cases: Iterable[Case]) -> list[str]:
    """Names of the cases with the same verdict; none if the verdict is good."""
    return [case.name for case in cases if case.verdict == verdict != "pass"]
