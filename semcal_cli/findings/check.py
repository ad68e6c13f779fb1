"""All checks with their limits and the sources of these, in the order of docs/troubleshooting.md.

That page quotes and explains the finding of each check.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from semcal_cli.config import MIN_OVERLAP, PolishConfig, PyramidConfig
from semcal_cli.errors import format_against_limit
from semcal_cli.findings.finding import Finding

LIMITS_FILE = Path(__file__).with_name("limits.json")
"""Limits by topic and name, with what `tests/benchmarks/check_limits.py` measured on both sides of each."""


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Values that one command measured on both sides of a limit."""

    command: str
    first_seed: int
    num_seeds: int
    num_good: int
    """Number of calibrations of good drives."""
    worst_good: float
    """Value of the good drive that is nearest to the limit, or farthest beyond it."""
    num_good_beyond: int = 0
    """Number of good drives beyond the limit, which are not trusted."""
    bad_kind: str | None = None
    """What was wrong with the bad drives; None if no kind of bad drive belongs to the limit."""
    num_bad: int = 0
    mildest_bad: float | None = None
    """Value of the bad drive that is nearest to the limit, or farthest within it."""
    num_bad_within: int = 0
    """Number of bad drives within the limit, which other checks have to find."""
    by_rule: float | None = None
    """Limit that the rule of the command derives; None where good and bad drives overlap."""


@dataclass(frozen=True, kw_only=True)
class Limit:
    """Largest or smallest value without a finding, and where it comes from."""

    at_most: float | None = None
    at_least: float | None = None
    unit: str = ""
    """Unit of the value; "%" for a share of 1."""
    source: str = ""
    """Where the limit comes from, in addition to what was measured."""
    measured: Evidence | None = None

    @property
    def value(self) -> float:
        """The limit itself."""
        value = self.at_least if self.at_most is None else self.at_most
        assert value is not None
        return value

    @property
    def sign(self) -> int:
        """1 if larger values are worse, -1 if smaller ones are."""
        return -1 if self.at_most is None else 1

    def is_kept_by(self, value: float) -> bool:
        """Whether a value is within the limit."""
        return self.sign * value <= self.sign * self.value

    def words(self, value: float) -> str:
        """Format a value with its unit."""
        if self.unit == "%":
            return f"{100.0 * value:.3g} %"
        number = f"{value:.3g}"
        return f"{number} {self.unit.removesuffix('s') if number == '1' else self.unit}".strip()


def read_limits(text: str) -> dict[str, dict[str, Limit]]:
    """Read limits by topic and name from JSON."""

    def entry(pairs: dict[str, Any]) -> object:
        if "num_good" in pairs:
            return Evidence(**pairs)
        return Limit(**pairs) if {"at_most", "at_least"} & pairs.keys() else pairs

    limits: dict[str, dict[str, Limit]] = json.loads(text, object_hook=entry)
    return limits


LIMITS = read_limits(LIMITS_FILE.read_text(encoding="utf-8"))


def fit_of_rival(behind: float, least: float, digits: int) -> str:
    """Say how well a rival explains the data, to follow "explains the data".

    Args:
        behind: Standard errors by which it is worse than what was found; negative if it is better.
        least: Standard errors by which it would have to be worse.
        digits: Minimum number of digits after the decimal point.
    """
    apart, needed = format_against_limit(abs(behind), least, digits)
    if behind < 0.0:
        return f"better, by {apart} standard errors, but must be worse by at least {needed}"
    return f"almost as well: only {apart} standard errors worse, needed at least {needed}"


class Measured(NamedTuple):
    """What a check measured on a drive, with a finding if the value is beyond its limit."""

    topic: str
    limit: str
    """Name of the limit that the value is compared with."""
    value: float | None
    """The value; None for a finding that does not rest on a single value."""
    finding: Finding | None = None

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The finding, if there is one."""
        return () if self.finding is None else (self.finding,)


@dataclass(frozen=True)
class Check:
    """A check of a pose against a limit, and what to do if it fails."""

    topic: str
    """Short name that stays when sentences change, and the anchor of the entry in docs/troubleshooting.md."""
    advice: str
    """What to do about it, in the imperative."""
    settings: Mapping[str, Limit] = field(default_factory=dict)
    """Limits by name that are settings, in addition to those in limits.json."""

    @property
    def limits(self) -> dict[str, Limit]:
        """All limits by name; a single limit has an empty name."""
        return {**self.settings, **LIMITS.get(self.topic, {})}

    def limit(self, name: str = "") -> float:
        """Look up a limit."""
        return self.limits[name].value

    def finding(self, found: str) -> Finding:
        """Make a finding from a sentence that gives the figure and what was needed."""
        return Finding(self.topic, found, self.advice)

    def without_value(self, found: str) -> Measured:
        """Make a finding that does not rest on a single value."""
        return Measured(self.topic, "", None, self.finding(found))

    def measured(self, value: float, found: str = "", limit: str = "") -> Measured:
        """Compare a value with a limit.

        Args:
            value: What was measured.
            found: Sentence of the finding; empty if the value makes no finding.
            limit: Name of the limit.
        """
        is_bad = found and not self.limits[limit].is_kept_by(value)
        return Measured(self.topic, limit, value, self.finding(found) if is_bad else None)


def findings_among(measured: Iterable[Measured]) -> tuple[Finding, ...]:
    """List the findings of all measurements."""
    return tuple(finding for each in measured for finding in each.findings)


SETTING = partial(Limit, source="a setting")
# What several checks advise.
ELSEWHERE = "add frames from other places"
BY_HAND = f"{ELSEWHERE}, or measure the mounting by hand and give it with --init"
NEARER = "add frames, or start nearer with --init"
OR_ESTIMATE_K = "or calibrate with --refine-intrinsics fx,fy,cx,cy"
GIVE_MOTION = "give motion.poses or motion.twist in the drive, or record at lower speed"

# The mounting is not clear.
OTHER_MOUNTING = Check("other-mounting", BY_HAND)
NOTHING_TO_COMPARE = Check("nothing-to-compare", BY_HAND)
OTHER_AZIMUTH = Check("other-azimuth", BY_HAND)
OTHER_POSE = Check("other-pose", ELSEWHERE)
FEW_SCENES = Check("few-scenes", ELSEWHERE)
CUES_DISAGREE = Check(
    "cues-disagree", f"{ELSEWHERE}, or check with `semcal overlay --by edge` whether edges line up"
)
CAMERA_MOTION = Check(
    "camera-motion",
    "check with `semcal overlay` whether points lie on their objects, and check K, the clocks and the motion",
)
# The labels do not determine the pose.
NOT_DETERMINED = Check(
    "not-determined",
    "record frames with near and far objects on both sides of the image, or give a measured position with "
    "--prior-translation-m",
)
NOT_DETERMINED_TOGETHER = Check(
    "not-determined-together",
    "record frames with near and far objects, or give more with --prior-translation-m and --prior-rotation-deg",
)
WIDE_INTERVAL = Check("wide-interval", "add frames with near and far objects, recorded while driving")
NO_DIRECTION = Check("no-direction", "record frames with more classes, such as poles, cars and kerbs")
ONE_CLASS = Check("one-class", "record frames with more kinds of objects, or label more classes")
NOTHING_LABELLED = Check("nothing-labelled", "label them, or check which ids the drive ignores")
OVERLAP = Check(
    "overlap",
    "label more points, or check which ids the drive ignores",
    {"": SETTING(at_least=MIN_OVERLAP, unit="%")},
)
CHANCE = Check("chance", "check that the labels belong to these sweeps and images")
# The search for the pose did not converge.
REFINEMENT_NOT_SETTLED = Check(
    "refinement-not-settled", NEARER, {"": SETTING(at_most=PyramidConfig.max_final_drift, unit="blocks")}
)
POLISH_NOT_SETTLED = Check(
    "polish-not-settled", NEARER, {"": SETTING(at_most=PolishConfig.settled_px, unit="pixels")}
)
POLISH_REJECTED = Check(
    "polish-rejected",
    "check with `semcal inspect` that sweeps, images and labels belong together, or add frames",
    {
        "": SETTING(at_most=PolishConfig.max_loss, unit="standard errors"),
        "several starts": SETTING(at_most=PolishConfig.max_loss_among_maxima, unit="standard errors"),
    },
)
POLISH_NOT_TESTED = Check("polish-not-tested", "add frames, or label more pixels")
FUSION_NOT_SETTLED = Check("fusion-not-settled", NEARER)
SEEDS = Check("seeds", ELSEWHERE)
# Files do not belong together.
WRONG_PAIRING = Check(
    "wrong-pairing", "compare times and names to check that sweeps and images belong together"
)
ODD_FRAMES = Check("odd-frames", "check the times and names of the files, or remove these frames")
SHIFTED_POINT_LABELS = Check(
    "shifted-point-labels",
    "check that no points were skipped when they were written, and label these sweeps again",
)
SHIFTED_LABEL_IMAGES = Check(
    "shifted-label-images",
    "check that they were made from these images at the same size, and label them again",
)
LEAKED_LABELS = Check(
    "leaked-labels", "label the points without the images, or calibrate with --cue segments,edges"
)
OWN_DRIVE = Check(
    "own-drive",
    "check it on another drive, because a transform always agrees with the drive that it was calibrated on",
)
FRAMES_DISAGREE = Check(
    "frames-disagree",
    "check the times of sweeps and images, the motion and the labels, or remove these frames",
)
MOVED_CAMERA = Check(
    "moved-camera", "calibrate the frames of each part as a drive of their own, or record again"
)
# Camera, clocks and motion.
WRONG_FOCAL_LENGTH = Check(
    "focal-length", f"check fx and fy in K, and that K belongs to images of this size, {OR_ESTIMATE_K}"
)
WRONG_INTRINSICS = Check(
    "intrinsics",
    "check K and the distortion, and that K belongs to images of this size, or calibrate the lens again, "
    f"{OR_ESTIMATE_K}",
)
WRONG_CLOCKS = Check(
    "clocks",
    "check the clocks of camera and LiDAR, and correct image_stamp, or calibrate with --estimate-delay",
)
MOTION = Check("motion", GIVE_MOTION)
SHUTTER = Check("shutter", GIVE_MOTION)
FAR_CAMERA = Check("baseline", "give a larger --max-baseline-m if the camera is farther away")
# What you stated contradicts the data.
PRIOR = Check("prior", "measure it again, or give a larger SIGMA")

CHECKS = {check.topic: check for check in vars().copy().values() if isinstance(check, Check)}
"""All checks by topic."""
