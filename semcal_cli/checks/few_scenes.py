"""Whether edges were compared in enough scenes."""

from __future__ import annotations

from semcal_cli.errors import counted
from semcal_cli.findings.check import Check, Measured
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.phrases import ELSEWHERE

FEW_SCENES = Check(
    topic="few-scenes",
    advice=ELSEWHERE,
    entry=Entry(
        title="Edges of few scenes",
        section=PageSection.MOUNTING,
        quotes=("edges were compared in 2 scenes, needed at least 4: add frames from other places",),
        meaning="The edges of one scene fit many poses, and which of them fits best is partly chance.",
        cause="The drive has one to three frames, or all its frames show the same scene.",
        remedy="Add frames from other places: ten are better than four.",
        figure="Number of scenes whose edges are compared. The check applies to edges.",
    ),
)


def check_scenes(num_scenes: int) -> Measured:
    """Check that edges were compared in enough scenes, from which they, and labels with one maximum, are trusted."""
    compared = f"edges were compared in {counted(num_scenes, 'scene')}"
    return FEW_SCENES.measured(num_scenes, f"{compared}, needed at least {FEW_SCENES.limit()}")
