"""Compares what the checks measure on good and bad drives, by labels and by segments, with their limits.

    python tests/benchmarks/check_limits.py --first-seed 96000 --seeds 6

Takes 19 calibrations per drive. Writes results.csv, summary.json, table.md and limits.json, for the next version, to a
folder in `semcal_experiments`, where a stopped run resumes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from benchmark import OUTPUT, KeptTable, run_experiment, script
from laboratory import spoiling
from laboratory.outcomes import OTHER_DRIVE, distance_in_limits, errors_of
from laboratory.raw_drive import Labels, RawDrive, read_raw_drive, write_raw_drive
from laboratory.rigs import RIGS, rig_of
from laboratory.spoiled import KINDS as SPOILED, Spoil

from semcal_cli.checks.registry import CHECKS
from semcal_cli.config import CalibrationConfig, CueName
from semcal_cli.drive.document import Drive
from semcal_cli.errors import SemcalError
from semcal_cli.estimation.search.mounting_search import Initialization
from semcal_cli.experiments.drives import Pool
from semcal_cli.experiments.experiment_run import Experiment, Report
from semcal_cli.experiments.summary import markdown_table
from semcal_cli.findings.check import LIMITS, Evidence, Limit
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.frame_selection import with_frames
from semcal_cli.observations.loading import load
from semcal_cli.pipeline import assess, initialize, refine_and_polish

PAIRS, FEW_PAIRS = (5, 8), (1, 2)
NUM_FRAMES: dict[str, object] = {"num_frames": max(PAIRS) + 1}
"""Change of each rig: frames of a drive, one more than are used."""
NOISES = (0.0, 0.1, 0.2)
DELAY_MS = 40.0
LIMITS_FILE = "limits.json"
MARGIN = 1.25
"""Factor between the worst good value and the limit where there are no bad drives."""
QUANTILE = 0.05
"""Fraction of the bad drives that a limit set by the rule may miss."""
RULE = (
    f"The rule: midway between the worst good value and the value that {1 - QUANTILE:.0%} of the bad drives exceed; "
    f"none where these overlap; {MARGIN:g} times the worst good value where there are no bad drives.\n"
)


def _of_another_drive(raw: RawDrive, rng: np.random.Generator) -> RawDrive:
    """Pair each cloud with the image of another drive of the same rig."""
    return raw.with_frames(
        own.with_image_of(other) for own, other in zip(raw.frames, raw.unused, strict=True)
    )


def _one_class(raw: RawDrive, rng: np.random.Generator) -> RawDrive:
    """Give all points and pixels the most frequent class of the points, except for one label in a hundred."""
    counts = np.bincount(np.concatenate([frame.point_labels for frame in raw.frames]))
    counts[spoiling.UNLABELLED] = 0

    def mostly_one(ids: Labels) -> Labels:
        return np.where(rng.random(ids.shape) < 0.01, ids, counts.argmax()).astype(np.uint8)

    return raw.with_frames(
        replace(each, point_labels=mostly_one(each.point_labels), image_labels=mostly_one(each.image_labels))
        for each in raw.frames
    )


def _labelled_from_images(raw: RawDrive, rng: np.random.Generator) -> RawDrive:
    """Label points by the pixels that they land on, as tools do that project label images into clouds."""
    return spoiling.projected_labels(raw, raw.frames[0].T_camera_lidar)


GOOD, FEW, MOVING = "good", "good, few pairs", "good, moving"
ANOTHER_DRIVE = "images of another drive"
ANOTHER_MOMENT = "one image of another moment"
TURNED = "each cloud turned by its own 0.7 to 1 degrees"
ONE_CLASS = "one class everywhere"
LABELLED_FROM_IMAGES = "point labels made from the images"
POINTS_SHIFTED, PIXELS_SHIFTED = "point labels shifted by 3", "image labels shifted by 3 to 4 px"
WRONG_K, WRONG_FX = "K wrong by 10 %", "fx alone wrong by 3 %"
LATE = f"images {DELAY_MS:g} ms late"
WRONG_POSE = "a wrong pose"
"""Not a kind of drive: a good drive whose calibration ended elsewhere."""
KINDS: dict[str, Spoil] = {
    GOOD: spoiling.as_it_is,
    FEW: spoiling.as_it_is,
    ANOTHER_DRIVE: _of_another_drive,
    WRONG_K: partial(spoiling.zoom_wrong, share=0.1),
    **{name: SPOILED[name].spoil for name in (ANOTHER_MOMENT, TURNED)},
    ONE_CLASS: _one_class,
    LABELLED_FROM_IMAGES: _labelled_from_images,
    **{name: SPOILED[name].spoil for name in (POINTS_SHIFTED, PIXELS_SHIFTED, WRONG_FX)},
}
"""Ways to change a good drive, by name."""
BY_SEGMENTS = (GOOD, FEW, ANOTHER_DRIVE, WRONG_K, ANOTHER_MOMENT, TURNED)
OF_CUES: dict[CueName, tuple[str, ...]] = {"labels": (*KINDS, MOVING, LATE), "segments": BY_SEGMENTS}
"""Kinds that are run with each cue."""
MOTIONS = {MOVING: 0.0, LATE: DELAY_MS}
"""Delay of the images of drives with a known motion, in milliseconds."""
BAD_OF = {
    "other-mounting": WRONG_POSE,
    "other-azimuth": ANOTHER_DRIVE,
    "other-pose": WRONG_POSE,
    "one-class": ONE_CLASS,
    "wrong-pairing": ANOTHER_DRIVE,
    "odd-frames": ANOTHER_MOMENT,
    "shifted-point-labels": POINTS_SHIFTED,
    "shifted-label-images": PIXELS_SHIFTED,
    "leaked-labels": LABELLED_FROM_IMAGES,
    "frames-disagree": TURNED,
    "focal-length": WRONG_K,
    "intrinsics": WRONG_FX,
    "clocks": LATE,
}
"""Kind of drive that each check is meant to catch, by the topic of the check."""


@dataclass(frozen=True)
class Case:
    """One calibration of a drive."""

    kind: str
    """Key of `KINDS` or of `MOTIONS`."""
    cue: CueName
    seed: int
    num_pairs: int
    noise: float
    """Fraction of wrong labels on both sides."""


@dataclass(frozen=True)
class Value:
    """What a check measured in one calibration."""

    kind: str
    cue: str
    seed: int
    rig: str
    num_pairs: int
    noise: float
    is_right: bool
    """Whether the pose is right, in the sense of `Outcome.is_wrong`."""
    topic: str
    """Topic of the check."""
    limit: str
    """Name of its limit."""
    value: float


def cases(seeds: range) -> list[Case]:
    """List the cases, seed by seed."""
    found = []
    for seed in seeds:
        rng = np.random.default_rng((seed, len(KINDS)))
        for cue, kind in ((cue, kind) for cue, kinds in OF_CUES.items() for kind in kinds):
            num_pairs = int(rng.choice(FEW_PAIRS if kind == FEW else PAIRS))
            found.append(Case(kind, cue, seed, num_pairs, float(rng.choice(NOISES))))
    return found


def run(pool: Pool, case: Case) -> list[Value]:
    """Calibrate a drive and list what the checks measured; empty if it cannot be calibrated."""
    with TemporaryDirectory() as folder:
        drive, truth = _drive(pool, case, Path(folder))
        config = CalibrationConfig(cues=(case.cue,))
        try:
            data = load(drive, config)
            stages = refine_and_polish(data, initialize(data, config.initialization), config.refinement)
            stages = assess(data, stages, config.refinement, with_label_bleed=False)
        except SemcalError:
            return []
    measured = []
    if isinstance(stages.initial, Initialization) and stages.initial.runner_up_margin is not None:
        measured.append(("other-mounting", "", stages.initial.runner_up_margin))
    if stages.assessment is not None:
        checks = stages.assessment.measured
        measured += [(each.topic, each.limit, each.value) for each in checks if each.value is not None]
    is_right = distance_in_limits(errors_of(stages.T_camera_lidar, truth)) <= 1.0
    about = {**vars(case), "rig": rig_of(case.seed), "is_right": is_right}
    return [
        Value(**about, topic=topic, limit=limit, value=value)
        for topic, limit, value in measured
        if np.isfinite(value)
    ]


def _drive(pool: Pool, case: Case, folder: Path) -> tuple[Path | Drive, Pose]:
    """Make the drive of a case, with its true pose (4, 4)."""
    rig = rig_of(case.seed)
    rng = np.random.default_rng((case.seed, case.num_pairs, *case.kind.encode(), *case.cue.encode()))
    if case.kind in MOTIONS:
        changes = RIGS[rig] | NUM_FRAMES | {"motion": "mixed", "delay_ms": MOTIONS[case.kind]}
        drive, truth = pool.read(f"{rig}_{case.kind.split()[-1]}", changes, case.seed)
        return with_frames(drive, range(case.num_pairs)), truth

    def read(seed: int, num_frames: int) -> RawDrive:
        """Read randomly chosen frames of a drive."""
        drive, truth = pool.read(rig, RIGS[rig] | NUM_FRAMES, seed)
        chosen = rng.choice(len(drive.frames), num_frames, replace=False).tolist()
        return read_raw_drive(with_frames(drive, chosen), truth)

    raw = read(case.seed, case.num_pairs + 1)
    unused = raw.frames[case.num_pairs :]
    if case.kind == ANOTHER_DRIVE:
        unused = read(case.seed + OTHER_DRIVE, case.num_pairs).frames
    raw = replace(raw, frames=raw.frames[: case.num_pairs], unused=unused)
    raw = KINDS[case.kind](spoiling.wrong_labels(raw, rng, case.noise), rng)
    return write_raw_drive(raw, folder), raw.frames[0].T_camera_lidar


def rows(values: Sequence[Value]) -> list[dict[str, Any]]:
    """Compare each measured limit with the values of good and bad drives.

    Returns:
        For each limit its `topic`, its `name`, its value `today`, and the figures of an `Evidence`.
    """
    found = []
    for topic, check in CHECKS.items():
        for name, limit in check.limits.items():
            of_limit = [each for each in values if (each.topic, each.limit) == (topic, name)]
            if figures := _figures(BAD_OF.get(topic), limit, of_limit):
                found.append({"topic": topic, "name": name, "today": limit.value, **figures})
    return found


def _figures(kind: str | None, limit: Limit, values: Sequence[Value]) -> dict[str, Any]:
    """Compute the figures of a limit from its values; empty without values of good drives."""
    on_good_drives = [each for each in values if each.kind in (GOOD, FEW, MOVING)]
    good = _worst_of_each([each for each in on_good_drives if each.is_right], limit)
    if not good:
        return {}
    of_bad = [each for each in values if each.kind == kind]
    if kind == WRONG_POSE:
        of_bad = [each for each in on_good_drives if not each.is_right]
    bad = _worst_of_each(of_bad, limit)
    by_rule = _by_rule(limit.sign, [limit.sign * x for x in good], [limit.sign * x for x in bad])
    return {
        "num_good": len(good),
        "worst_good": _short(max(good, key=lambda x: limit.sign * x)),
        "num_good_beyond": sum(not limit.is_kept_by(x) for x in good),
        "bad_kind": kind if bad else None,
        "num_bad": len(bad),
        "mildest_bad": _short(min(bad, key=lambda x: limit.sign * x)) if bad else None,
        "num_bad_within": sum(limit.is_kept_by(x) for x in bad),
        "by_rule": None if by_rule is None else _short(by_rule),
    }


def _worst_of_each(values: Sequence[Value], limit: Limit) -> list[float]:
    """Take the worst value of each calibration, since some checks measure both sides and the worse one decides."""
    found: dict[tuple[str, str, int], float] = {}
    for each in values:
        case = (each.kind, each.cue, each.seed)
        worst = max(limit.sign * each.value, limit.sign * found.get(case, each.value))
        found[case] = limit.sign * worst
    return list(found.values())


def _by_rule(sign: int, good: Sequence[float], bad: Sequence[float]) -> float | None:
    """Compute the limit by the rule, from values that are worse the larger they are."""
    worst = max(good)
    if not bad:
        return sign * worst * MARGIN**sign
    least_bad = float(np.quantile(bad, QUANTILE))
    return sign * 0.5 * (worst + least_bad) if least_bad > worst else None


def _short(value: float) -> float:
    return float(f"{value:.4g}")


def limits_text(found: Sequence[Mapping[str, Any]], command: str, seeds: range) -> str:
    """Write all limits in the form of limits.json: today's values with the new evidence."""
    about: dict[str, Any] = {"command": command, "first_seed": seeds.start, "num_seeds": len(seeds)}
    names = {field.name for field in fields(Evidence)}
    evidence = {
        (row["topic"], row["name"]): Evidence(**about, **{key: row[key] for key in names & row.keys()})
        for row in found
    }
    document = {
        topic: {
            name: _entry(replace(limit, measured=evidence.get((topic, name), limit.measured)))
            for name, limit in limits.items()
        }
        for topic, limits in LIMITS.items()
    }
    return json.dumps(document, indent=2) + "\n"


def _entry(limit: Limit) -> dict[str, object]:
    return {key: value for key, value in asdict(limit).items() if value not in (None, "")}


def markdown(found: Sequence[Mapping[str, Any]]) -> str:
    """Format the table."""
    headers = ("check", "limit", "good", "worst", "beyond", "bad drives", "mildest", "within", "limit today")
    lines = []
    for row in found:
        words = CHECKS[row["topic"]].limits[row["name"]].words
        bad: list[object] = ["", "", ""]
        if row["mildest_bad"] is not None:
            bad = [f"{row['num_bad']}, {row['bad_kind']}", words(row["mildest_bad"]), row["num_bad_within"]]
        by_rule = "none" if row["by_rule"] is None else words(row["by_rule"])
        good = [row["num_good"], words(row["worst_good"]), row["num_good_beyond"]]
        lines.append([row["topic"], row["name"], *good, *bad, words(row["today"]), by_rule])
    return markdown_table((*headers, "by the rule"), lines)


def _report(seeds: range, values: Sequence[Value]) -> Report:
    command = f"python tests/benchmarks/check_limits.py --first-seed {seeds.start} --seeds {len(seeds)}"
    found = rows(values)
    texts = {LIMITS_FILE: limits_text(found, command, seeds)}
    return Report(found, f"{markdown(found)}\n{RULE}", texts=texts)


def main(*, seeds: int = 6, first_seed: int = 96_000, jobs: int = 1, output: Path = OUTPUT) -> KeptTable:
    """Measure all limits."""
    chosen = range(first_seed, first_seed + seeds)
    run_case = partial(run, Pool(output / "pool_of_limits", has_images=True))
    report = partial(_report, chosen)
    measured = Experiment("limits", output / "limits", cases(chosen), run_case, Value, report)
    return run_experiment(measured, jobs)


if __name__ == "__main__":
    script(main)
