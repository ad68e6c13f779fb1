"""What CI systems show: JUnit XML, and on GitHub annotations and a table in the job summary."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Literal, TypeAlias

import click

from semcal_cli.documentation import entry_address
from semcal_cli.errors import InputError, SemcalError, first_of, os_reason
from semcal_cli.readable import for_people, signed

if TYPE_CHECKING:
    from semcal_cli.many.rig.rig_verification import RigVerdict
    from semcal_cli.pipeline.verdict import AxisVerdict, Verdict

NO_XML = "[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]"
"""Characters that XML 1.0 does not allow. It is compiled where it is used, because that takes 6 ms."""

GITHUB_ACTIONS, GITHUB_STEP_SUMMARY = "GITHUB_ACTIONS", "GITHUB_STEP_SUMMARY"
"""Environment variables of a GitHub job: `true`, and the file of the job summary."""
XML_START = b"<?xml"
EXIT_CODES: dict[Verdict, int] = {"pass": 0, "fail": 3, "inconclusive": 4}
Inconclusive: TypeAlias = Literal["error", "fail", "skip"]
"""How CI counts an inconclusive verdict: as an error (exit code 4), a failure (3), or skipped (0)."""
INCONCLUSIVE_CODES: dict[Inconclusive, int] = {"error": 4, "fail": 3, "skip": 0}
ELEMENTS: dict[Inconclusive, str] = {"error": "error", "fail": "failure", "skip": "skipped"}
AnnotationLevel: TypeAlias = Literal["notice", "warning", "error"]
LEVELS: dict[Verdict, AnnotationLevel] = {"pass": "notice", "fail": "error", "inconclusive": "warning"}
MAX_CASES = 20
"""Largest number of cases that an annotation names; the files list all."""


@dataclass(frozen=True)
class Case:
    """A test case for CI, made from one check."""

    name: str
    verdict: RigVerdict
    figures: str
    """What was found, and what was allowed."""

    @classmethod
    def of_check(cls, check: AxisVerdict) -> Case:
        """Make a test case from a check."""
        from semcal_cli.pipeline.verdict import figures

        return cls(check.name, check.verdict, figures(check))


@dataclass(frozen=True)
class CiReport:
    """The verdict of a command with its cases, for JUnit XML and for GitHub."""

    command: str
    """Name of the command."""
    subject: str
    """What was judged: the drive, or the folder of results."""
    verdict: RigVerdict
    cases: Sequence[Case]
    reasons: Sequence[str] = ()
    """Sentences about all cases together."""
    topics: Sequence[str] = ()
    """Topic of each reason, whose entry in the documentation JUnit names; empty if the reasons have none."""
    seconds: float = 0.0
    """Duration of the command. 0 leaves it out, for files whose bytes must be reproducible."""
    inconclusive: Inconclusive = "error"

    @property
    def exit_code(self) -> int:
        """The exit code of the verdict."""
        if self.verdict == "inconclusive":
            return INCONCLUSIVE_CODES[self.inconclusive]
        return 1 if self.verdict == "failed" else EXIT_CODES[self.verdict]

    def junit(self) -> str:
        """Make JUnit XML with a test case for each check, and the reasons with their entries as the suite's output."""
        elements: dict[RigVerdict, str] = {
            "fail": "failure",
            "inconclusive": ELEMENTS[self.inconclusive],
            "failed": "error",
        }
        cases = [(case.name, elements.get(case.verdict), case.figures) for case in self.cases]
        reasons = self.reasons
        if self.topics:
            pairs = zip(self.reasons, self.topics, strict=True)
            reasons = [f"{reason} ({entry_address(topic)})" for reason, topic in pairs]
        return _suite(self.command, self.subject, cases, reasons, self.seconds)

    def tell_github(self) -> None:
        """Print an annotation and add a table to the job summary, in a GitHub job."""
        same = [case for case in self.cases if case.verdict == self.verdict != "pass"]
        texts = first_of([f"{case.name} {case.figures}".strip() for case in same], MAX_CASES)
        if self.verdict != "failed":  # The error itself is annotated.
            annotate(self.command, LEVELS[self.verdict], "; ".join([self.verdict, *texts, *self.reasons]))
        rows = [f"| {_cell(case.name)} | {_cell(case.figures)} | {case.verdict} |" for case in self.cases]
        table = ["", "| | found | verdict |", "|---|---|---|", *rows] if rows else []
        reasons = ["", *(f"- {_cell(reason)}" for reason in self.reasons)]
        title = f"### semcal {self.command}: {self.verdict}"
        add_to_summary([title, "", f"`{_cell(self.subject)}`", *table, *reasons])


@contextmanager
def errors_reported(command: str, subject: str, junit: Path | None, read: Sequence[Path]) -> Iterator[None]:
    """Write an error of the command itself to the JUnit file, and raise it again.

    A file that the command reads, or that holds anything but XML, is never replaced.
    """
    start = perf_counter()
    try:
        yield
    except SemcalError as error:
        from semcal_cli.files.output_files import write_text

        if junit is not None and _may_replace(junit, read):
            with suppress(InputError):
                cases = [("result", "error", str(error))]
                write_text(_suite(command, subject, cases, (), perf_counter() - start), junit)
        raise


def _may_replace(junit: Path, read: Sequence[Path]) -> bool:
    """Whether a file is not an input, and is new or holds XML."""
    from semcal_cli.files.input_files import is_same_file, read_start

    if any(is_same_file(path, junit) for path in read):
        return False
    return not junit.is_file() or read_start(junit, len(XML_START)) == XML_START


def annotate(command: str, level: AnnotationLevel, text: str) -> None:
    """Print an annotation if this is a GitHub job; GitHub reads stderr, too."""
    if os.environ.get(GITHUB_ACTIONS) != "true":
        return
    for character, code in (("%", "%25"), ("\r", "%0D"), ("\n", "%0A")):
        text = text.replace(character, code)
    click.echo(f"::{level} title=semcal {command}::{for_people(text)}", err=True)


def add_to_summary(lines: Sequence[str]) -> None:
    """Append lines of Markdown to the summary of a GitHub job, the file that `GITHUB_STEP_SUMMARY` names."""
    path = os.environ.get(GITHUB_STEP_SUMMARY)
    if not path:
        return
    try:
        with Path(path).open("a", encoding="utf-8") as file:
            file.write(signed("\n".join(lines)).rstrip() + "\n\n")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {os_reason(error)}") from None


def _suite(
    command: str,
    subject: str,
    cases: Sequence[tuple[str, str | None, str]],
    reasons: Sequence[str],
    seconds: float,
) -> str:
    """Make JUnit XML of cases: name, element unless the case passes, and figures."""
    from xml.etree import ElementTree

    kinds = [kind for _, kind, _ in cases]
    counts = {"failures": "failure", "skipped": "skipped", "errors": "error"}
    attributes = {"name": f"semcal {command}", "tests": str(len(cases))}
    attributes |= {name: str(kinds.count(kind)) for name, kind in counts.items()}
    suite = ElementTree.Element("testsuite", attributes | ({"time": f"{seconds:.3f}"} if seconds else {}))
    for name, kind, text in cases:
        attributes = {"classname": f"semcal.{command}", "name": _xml(name), "file": _xml(subject)}
        if seconds:
            attributes["time"] = f"{seconds / len(cases):.3f}"
        element = ElementTree.SubElement(suite, "testcase", attributes)
        if kind is not None:
            ElementTree.SubElement(element, kind, message=_xml(text))
        else:
            ElementTree.SubElement(element, "system-out").text = _xml(text)
    if reasons:
        ElementTree.SubElement(suite, "system-out").text = _xml("\n".join(reasons))
    ElementTree.indent(suite)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(suite, encoding="unicode") + "\n"


def _xml(text: str) -> str:
    return re.sub(NO_XML, "?", text)


def _cell(text: str) -> str:
    """Make a text fit into a cell of a Markdown table."""
    return " ".join(text.split()).replace("|", "\\|").replace("`", "'")
