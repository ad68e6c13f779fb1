"""Whether edges were compared in enough scenes."""

from __future__ import annotations

from collections.abc import Mapping

from semcal_cli.config import CueName
from semcal_cli.errors import counted
from semcal_cli.findings.check import Check, Measured
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.phrases import ELSEWHERE
from semcal_cli.findings.symptoms import OF_A_WRONG_POSE

FEW_SCENES = Check(
    topic="few-scenes",
    advice=ELSEWHERE,
    explains=OF_A_WRONG_POSE | {"far-start", "weak-cue"},
    entry=Entry(
        title="Edges of few scenes",
        section=PageSection.MOUNTING,
        quotes=("the frames show 1 place; at least 4 are needed for edges: add frames from other places",),
        meaning="The edges of one scene fit many poses, and which of them fits best is partly chance.",
        cause="The drive has one to three frames, or all its frames show the same scene.",
        remedy="Add frames from other places: ten are better than four.",
        figure="Number of scenes whose edges are compared. The check applies to edges.",
    ),
)


def check_scenes(num_scenes: int, min_scenes: Mapping[CueName, int]) -> Measured:
    """Check that points and pixels were compared in enough scenes.

    Args:
        num_scenes: Number of scenes that the frames show.
        min_scenes: Minimum number of scenes of each cue that states one; not empty.
    """
    fewest = max(min_scenes.values())
    cues = " and ".join(min_scenes)
    sentence = f"the frames show {counted(num_scenes, 'place')}; at least {fewest} are needed for {cues}"
    finding = FEW_SCENES.finding(sentence) if num_scenes < fewest else None
    return Measured(FEW_SCENES.topic, "", num_scenes, finding)
