"""Findings in the order in which a person should doubt: likely causes first, what may follow from them last."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from semcal_cli.checks.far_start import check_start
from semcal_cli.checks.registry import CHECKS
from semcal_cli.checks.weak_cue import check_strength
from semcal_cli.findings.finding import Finding, Leading
from semcal_cli.findings.phrases import ESTIMATE, OR_CALIBRATE_CAMERA
from semcal_cli.geometry.poses import PoseError

ORDER = {topic: number for number, topic in enumerate(CHECKS)}


def diagnosed(
    findings: Sequence[Finding],
    *,
    weak: Sequence[str],
    start: str = "",
    near_only: Sequence[str] = (),
    moved: PoseError | None = None,
    estimated: Iterable[str] = (),
) -> tuple[Finding, ...]:
    """Add the causes that the circumstances suggest for findings, and put likely causes first.

    A finding comes last if another one explains it. What was done already is not advised.

    Args:
        findings: Everything that speaks against a pose.
        weak: Cues that the pose rests on, if all of them are weak; else none.
        start: Name of the start that was given; empty without one.
        near_only: Cues that need a start near the right pose, where nothing was searched around the given one.
        moved: Difference of the pose from the given start; None if it is not known.
        estimated: Names of intrinsics that were estimated together with the pose.
    """
    suggested = list(check_strength(weak, findings))
    if start:
        suggested += check_start(start, near_only, findings, moved)
    findings = (*suggested, *findings)
    topics = {finding.topic for finding in findings}
    explained = _explained_by(topics)

    def place(finding: Finding) -> tuple[bool, int]:
        is_cause = bool(CHECKS[finding.topic].explains & topics)
        return finding.topic in explained, ORDER[finding.topic] if is_cause else len(ORDER)

    known = {*estimated}
    return tuple(
        _as_advised(finding, known, has_start=bool(start)) for finding in sorted(findings, key=place)
    )


def leading(topics: Iterable[str]) -> Leading:
    """Find how many reasons come before those that may follow from others, by the topics of all in order."""
    topics = [*topics]
    explained = _explained_by({*topics})
    num = next((number for number, topic in enumerate(topics) if topic in explained), len(topics))
    return Leading(num, CHECKS[topics[0]].options if topics and topics[0] in CHECKS else ())


def _explained_by(topics: set[str]) -> set[str]:
    """Topics that any of the given ones explains; those of other versions explain nothing."""
    return {topic for cause in topics & CHECKS.keys() for topic in CHECKS[cause].explains}


def _as_advised(finding: Finding, estimated: set[str], *, has_start: bool) -> Finding:
    check = CHECKS[finding.topic]
    if has_start and check.advice_beside_start and finding.advice == check.advice:
        return finding._replace(advice=check.advice_beside_start)
    before, _, names = finding.advice.partition(ESTIMATE)
    if names and {*names.split(",")} <= estimated:
        return finding._replace(advice=f"{before}{OR_CALIBRATE_CAMERA}")
    return finding
