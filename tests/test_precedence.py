"""Which reason comes first, and what it advises: the likeliest cause, given what was typed and what the data say."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from commands import invoke
from test_calibration import POSE, make_calibration

from semcal_cli.checks.precedence import diagnosed, leading
from semcal_cli.checks.registry import CHECKS
from semcal_cli.cli.tables import figures, shown_reasons, verdict_lines
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.findings.finding import Finding
from semcal_cli.findings.symptoms import OF_THE_DRIVE
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.observations.cues.cue_table import policy_of
from semcal_cli.result.calibration_document import read_calibration
from semcal_cli.result.next_steps import after_calibration
from semcal_cli.synthetic.synthesis import synthesize

DRIVE, RESULT = Path("street"), Path("street.yaml")


def found(*topics: str) -> list[Finding]:
    return [CHECKS[topic].finding(f"found {topic}") for topic in topics]


@pytest.mark.parametrize(
    ("topics", "cues", "start", "first", "advice", "num_first"),
    [
        pytest.param(
            ("odd-frames", "wrong-pairing", "other-azimuth", "other-pose"),
            ("edges",),
            "--init-rpy-xyz",
            "far-start",
            "start nearer",
            3,
            id="a start with a wrong yaw is doubted before the files",
        ),
        pytest.param(
            ("other-azimuth",),
            ("labels",),
            "start.yaml",
            "other-azimuth",
            "add frames from other places",
            1,
            id="who gave a start is not told to measure one",
        ),
        pytest.param(
            ("other-azimuth",),
            ("labels",),
            "",
            "other-azimuth",
            "add frames from other places, or measure",
            1,
            id="who gave none is",
        ),
        pytest.param(
            ("polish-not-settled", "intrinsics"),
            ("labels",),
            "",
            "intrinsics",
            "check that the images were not cropped",
            1,
            id="a wrong K is doubted before a polish that it leaves unsettled",
        ),
        pytest.param(
            ("focal-length", "intrinsics", "other-pose"),
            ("intensity",),
            "",
            "weak-cue",
            "compare edges",
            1,
            id="intensity alone is doubted before K",
        ),
        pytest.param(
            ("focal-length",),
            ("segments",),
            "",
            "weak-cue",
            "compare edges",
            1,
            id="segments alone are doubted before K",
        ),
        pytest.param(
            ("focal-length",),
            ("segments", "edges"),
            "",
            "focal-length",
            "check fx and fy",
            1,
            id="beside edges, segments are no doubt",
        ),
        pytest.param(
            ("moved-camera", "clocks", "frames-disagree"),
            ("labels",),
            "",
            "clocks",
            "calibrate with --estimate-delay",
            1,
            id="late images are no knocked camera",
        ),
        pytest.param(
            ("other-azimuth", "wrong-pairing", "few-scenes", "other-pose", "wide-interval"),
            ("edges",),
            "--init",
            "few-scenes",
            "add frames from other places",
            1,
            id="one frame explains all that follows from it",
        ),
        pytest.param(
            ("moved-camera", "motion"),
            ("edges",),
            "a.yaml",
            "moved-camera",
            "calibrate the frames",
            2,
            id="a knocked camera says nothing about the start",
        ),
    ],
)
def test_the_likeliest_cause_comes_first(
    topics: tuple[str, ...], cues: tuple[str, ...], start: str, first: str, advice: str, num_first: int
) -> None:
    policy = policy_of(cues)
    near_only = policy.near_only if policy.needs_near_start else ()
    findings = diagnosed(found(*topics), weak=policy.weak, start=start, near_only=near_only)
    assert findings[0].topic == first
    assert findings[0].advice.startswith(advice)
    assert set(topics) <= {finding.topic for finding in findings}
    assert leading(finding.topic for finding in findings).num == num_first
    if start:
        assert not any("with --init" in finding.advice for finding in findings)


@pytest.mark.parametrize(
    ("topics", "moved_m", "is_doubted"),
    [
        (("other-pose", "wrong-pairing"), 0.2, False),
        (("other-pose", "wrong-pairing"), 0.4, True),
        (("other-pose", "other-azimuth"), 0.2, True),
    ],
)
def test_a_near_start_is_not_doubted_for_what_good_starts_have(
    topics: tuple[str, ...], moved_m: float, is_doubted: bool
) -> None:
    T = np.eye(4)
    T[0, 3] = moved_m
    moved = compare_poses(T, np.eye(4))
    findings = diagnosed(found(*topics), weak=(), start="a.yaml", near_only=("edges",), moved=moved)
    assert (findings[0].topic == "far-start") == is_doubted


def test_intrinsics_that_were_estimated_are_not_advised_to_be_estimated_again() -> None:
    asked = ("fx", "fy", "cx", "cy")
    (of_k, of_lens) = found("focal-length", "intrinsics")
    of_lens = of_lens._replace(advice=f"{of_lens.advice},k1")
    again, more = diagnosed((of_k, of_lens), weak=(), estimated=asked)[::-1]
    assert again.advice.endswith(", or calibrate the intrinsics of the camera anew, with a board")
    assert more == of_lens
    assert diagnosed((of_lens,), weak=(), estimated=(*asked, "k1"))[0].advice.endswith(" with a board")


def test_nothing_explains_itself_in_a_circle() -> None:
    assert all(check.explains <= CHECKS.keys() for check in CHECKS.values())
    assert CHECKS.keys() >= OF_THE_DRIVE
    explains = {topic: {*check.explains} for topic, check in CHECKS.items()}
    while leaves := {topic for topic, others in explains.items() if not others}:
        explains = {topic: others - leaves for topic, others in explains.items() if topic not in leaves}
    assert explains == {}


def test_what_follows_is_counted() -> None:
    findings = diagnosed(found("other-pose", "few-scenes"), weak=())
    reasons, topics = (tuple(finding[i] for finding in findings) for i in (1, 0))
    assert shown_reasons(reasons, topics) == [
        "found few-scenes",
        "1 more may follow from this (--verbose lists them)",
    ]
    assert shown_reasons(reasons, topics, verbose=True) == [*reasons]
    assert shown_reasons(("of an older version",), ()) == ["of an older version"]
    made = make_calibration(POSE).model_copy(
        update={"status": "not_trusted", "reasons": reasons, "topics": topics}
    )
    assert figures(made) == "1 doubt, and 1 that may follow"
    lines = [line for _, line in after_calibration(made, RESULT, leading(topics))]
    assert [line.partition("#")[2] for line in lines if "#" in line] == ["few-scenes"]


@pytest.mark.parametrize(
    ("cues", "command"),
    [
        ((), "semcal calibrate . --estimate-delay -o street_corrected.yaml"),
        (
            ("segments", "edges"),
            "semcal calibrate . --cue segments,edges --init street.yaml --estimate-delay -o street_corrected.yaml",
        ),
    ],
)
def test_what_corrects_the_first_reason_is_run_next(cues: tuple[str, ...], command: str) -> None:
    made = make_calibration(POSE)
    options = {"cues": {cue: {} for cue in cues}} if cues else {}
    doubted = made.model_copy(
        update={
            "status": "not_trusted",
            "reasons": ("late", "knocked"),
            "topics": ("clocks", "moved-camera"),
            "input": made.input.model_copy(update={"drive": "drive.yaml"}),
            "settings": made.settings.model_copy(update={"options": options}),
        }
    )
    assert after_calibration(doubted, RESULT, leading(doubted.topics))[0] == ("next", command)
    jointly = {"settings": made.settings.model_copy(update={"options": options | {"jointly": {}}})}
    estimated = after_calibration(doubted.model_copy(update=jointly), RESULT, leading(doubted.topics))
    assert "--estimate-delay" not in estimated[0][1]


def test_the_paper_method_says_that_nothing_was_checked() -> None:
    made = make_calibration(POSE)
    settings = made.settings.model_copy(update={"options": {"paper": {}}})
    stages = dict.fromkeys(("initial", "refined"), made.stages["initial"])
    unchecked = made.model_copy(
        update={"status": "not_assessed", "settings": settings, "uncertainty": None, "stages": stages}
    )
    assert " ".join(" ".join(verdict_lines(unchecked)).split()) == (
        "verdict not assessed: the paper's method checks nothing, so the pose may be far off"
    )
    assert " refine " in after_calibration(unchecked, RESULT)[0][1]


def test_late_images_are_estimated_next(tmp_path: Path) -> None:
    config = SynthConfig(num_frames=6, seed=11, width=640, height=360, motion="mixed", delay_ms=60.0)
    synthesize(config, tmp_path / "late")
    done = invoke("calibrate", tmp_path / "late", "-o", tmp_path / "late.yaml")
    made = read_calibration(tmp_path / "late.yaml")
    assert (done.exit_code, made.topics[0]) == (3, "clocks")
    (command,) = (line for line in done.stderr.splitlines() if line.startswith("next"))
    assert command.endswith(f"--estimate-delay -o {tmp_path}/late_corrected.yaml")
    said = " ".join(done.stderr.split())
    assert " 60." in said or " 59." in said
    assert "50 ms" not in said
    assert "as if it had been knocked" not in said


def test_a_start_with_a_wrong_yaw_is_doubted_first(drive: Path, tmp_path: Path) -> None:
    document = yaml.safe_load((drive / "drive.yaml").read_text())
    turn = math.radians(40.0)
    T = document["T_camera_lidar"]
    document["T_camera_lidar"] = [
        [math.cos(turn) * a + math.sin(turn) * c for a, c in zip(T[0], T[2], strict=True)],
        T[1],
        [math.cos(turn) * c - math.sin(turn) * a for a, c in zip(T[0], T[2], strict=True)],
        T[3],
    ]
    (tmp_path / "start.yaml").write_text(yaml.safe_dump({"T_camera_lidar": document["T_camera_lidar"]}))
    out = tmp_path / "out.yaml"
    done = invoke("calibrate", drive, "--cue", "edges", "--init", tmp_path / "start.yaml", "-o", out)
    made = read_calibration(out)
    assert (done.exit_code, made.topics[0]) == (3, "far-start"), made.topics
    assert "measure the mounting" not in done.stderr
