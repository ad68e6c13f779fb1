"""Whether a drive has enough scenes for its lens."""

from __future__ import annotations

from semcal_cli.errors import counted
from semcal_cli.findings.check import Check, Limit
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding

SAME_SCENES = Check(
    topic="same-scenes",
    advice="record while driving, past different objects",
    entry=Entry(
        title="Frames show the same scenes",
        section=PageSection.INSPECTION,
        quotes=(
            (
                "the 12 frames show 3 scenes, and frames of one scene count as one: record while driving, past "
                "different objects"
            ),
        ),
        meaning="Some frames were recorded at the same place, and add hardly any information.",
        cause="The rig stood, or moved slowly.",
        remedy="Record while driving, or leave out frames of the same place.",
    ),
)
FEW_FRAMES = Check(
    topic="few-frames",
    entry=Entry(
        title="There are few frames",
        section=PageSection.INSPECTION,
        quotes=(
            "2 frames: use at least 4 to find the mounting, and 20 for accuracy",
            "6 frames through a lens of 35 degrees across: use at least 20",
        ),
        meaning="The drive has fewer scenes than it takes to find the mounting, or than a narrow lens needs.",
        cause="The recording is short, or all frames show the same place.",
        remedy="Add frames from other places: [benchmarks.md](benchmarks.md) shows what more frames gain.",
        figure="Number of scenes.",
    ),
    settings={
        "mountings": Limit(at_least=4, unit="scenes", source="as many distinguish mountings"),
        "narrow lenses": Limit(
            at_least=20,
            unit="scenes",
            source="as many as the accuracy of docs/benchmarks.md is measured with",
        ),
    },
)
NARROW_DEG = 50.0
"""Horizontal field of view below which a lens needs more frames."""


def check_frame_count(num_frames: int, num_scenes: int, across_deg: float) -> tuple[Finding, ...]:
    """Report if scenes are probably too few for the horizontal field of view of the lens, in degrees.

    See docs/benchmarks_stages.md, the initial calibration.
    """
    fewest, usual = (int(FEW_FRAMES.limit(name)) for name in ("mountings", "narrow lenses"))
    findings, shown = list[Finding](), counted(num_frames, "frame")
    if num_scenes < min(num_frames, usual):
        shown = counted(num_scenes, "scene")
        findings.append(
            SAME_SCENES.finding(f"the {num_frames} frames show {shown}, and frames of one scene count as one")
        )
    if num_scenes < fewest:
        sentence = f"{shown}: use at least {fewest} to find the mounting, and {usual} for accuracy"
        findings.append(FEW_FRAMES.finding(sentence))
    elif across_deg < NARROW_DEG and num_scenes < usual:
        sentence = f"{shown} through a lens of {across_deg:.0f} degrees across: use at least {usual}"
        findings.append(FEW_FRAMES.finding(sentence))
    return tuple(findings)
