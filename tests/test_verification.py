"""`verify` and `compare` through the real command: every exit code, and every mistake that is recognised."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import junitparser
import numpy as np
import pytest
import yaml
from click.testing import Result
from commands import invoke
from conftest import edited, make_pose, run
from scipy.spatial.transform import Rotation
from test_precedence import found

from semcal_cli.cli import semcal
from semcal_cli.cli.ci import Case, CiReport
from semcal_cli.config import Limits
from semcal_cli.documentation import entry_address
from semcal_cli.drive.document import DRIVE_FILE
from semcal_cli.errors import InputError
from semcal_cli.estimation.search.mounting_search import Initialization
from semcal_cli.files.documents import document_text, read_document
from semcal_cli.files.output_files import write_text
from semcal_cli.findings.symptoms import LOOKS_LIKE
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import (
    OPTICAL_AXES,
    compare_poses,
    inverse,
    pose_from_quaternion,
    quaternion_xyzw,
)
from semcal_cli.pipeline import verification
from semcal_cli.pipeline.mistaken_transform import likely_mistakes
from semcal_cli.pipeline.pose_stages import initialize
from semcal_cli.pipeline.stages import Stages
from semcal_cli.pipeline.verdict import figures, judge, overall_offsets, sufficient_limits
from semcal_cli.result.calibration_document import read_calibration, write_calibration

PASS, FAIL, INCONCLUSIVE = 0, 3, 4
GREEN, RED = "\x1b[1;32m", "\x1b[1;31m"
"""Starts of the lines of verdicts on a terminal."""


def write_transform(T: Pose, street: Path, folder: Path) -> Path:
    """A drive whose reference it is: a format that `read_transform` knows."""
    document = read_document(street / DRIVE_FILE) | {"T_camera_lidar": T.tolist()}
    write_text(document_text(document, "yaml"), folder / "given.yaml")
    return folder / "given.yaml"


def verify(*arguments: object, **environment: str) -> Result:
    return invoke("verify", *arguments, "-q", env=environment)


def turned(T: Pose, angle_deg: float) -> Pose:
    """Turned about an axis of the camera, which stays in its place."""
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_rotvec([0.0, np.radians(angle_deg), 0.0]).as_matrix()
    return turn @ T


def moved(T: Pose, meters: float) -> Pose:
    return make_pose((0.0, 0.0, 0.0), (0.0, meters, 0.0)) @ T


@pytest.mark.parametrize(
    ("change", "code", "failing"),
    [
        (lambda T: T, PASS, []),
        (lambda T: turned(T, 0.25), FAIL, ["rotation y", "rotation overall"]),
        (lambda T: moved(T, 0.06), FAIL, ["camera centre y", "camera centre overall"]),
        (lambda T: turned(T, 3.0), FAIL, ["rotation y", "rotation overall"]),
    ],
)
def test_verdicts(
    street: Path,
    street_truth: Pose,
    tmp_path: Path,
    change: Callable[[Pose], Pose],
    code: int,
    failing: list[str],
) -> None:
    given = write_transform(change(street_truth), street, tmp_path)
    limits = ("--max-rotation-deg", 0.15, "--max-translation-m", 0.03)
    found = verify(street, given, *limits, "--json", "--junit", tmp_path / "junit.xml")
    assert found.exit_code == code, found.output
    report = json.loads(found.stdout)
    assert report["verdict"] == ("fail" if failing else "pass")
    assert [check["name"] for check in report["checks"] if check["verdict"] == "fail"] == failing
    error = compare_poses(np.array(report["T_camera_lidar"]), street_truth)
    assert error.rotation_deg < 0.1
    (suite,) = junitparser.JUnitXml.fromfile(str(tmp_path / "junit.xml"))
    assert (suite.tests, suite.failures) == (8, len(failing))
    assert [
        case.name for case in suite if any(isinstance(r, junitparser.Failure) for r in case.result)
    ] == failing


@pytest.mark.parametrize(
    ("others", "angle_deg", "is_searched"),
    [((), 0.0, False), (("motion",), 0.0, False), (("overlap",), 0.0, True), ((), 30.0, True)],
)
def test_other_mountings_are_searched_where_another_pose_may_be_better(
    others: tuple[str, ...],
    angle_deg: float,
    is_searched: bool,
    drive: Path,
    street_truth: Pose,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Only the clocks speak against any pose of this drive, unless a test adds to it."""
    with edited(drive) as document:
        del document["synchronization"]
    assess, searches = verification.assess, list[int]()

    def with_others(*arguments: Any, **options: Any) -> Stages:
        stages = assess(*arguments, **options)
        assert stages.assessment is not None
        added = replace(stages.assessment, findings=(*stages.assessment.findings, *found(*others)))
        return replace(stages, assessment=added)

    def count(*arguments: Any, **options: Any) -> Initialization:
        searches.append(1)
        return initialize(*arguments, **options)

    monkeypatch.setattr(verification, "assess", with_others)
    monkeypatch.setattr(verification, "initialize", count)
    given = write_transform(turned(street_truth, angle_deg), drive, tmp_path)
    result = verify(drive, given, "--json")
    assert (result.exit_code, bool(searches)) == (INCONCLUSIVE, is_searched)
    assert set(json.loads(result.stdout)["topics"]) >= {"untied-clocks", *others}


def test_junit_names_the_entry_of_each_reason() -> None:
    reasons, topics = ("few < many", "late"), ("overlap", "clocks")
    report = CiReport("verify", "drive", "inconclusive", [Case("x", "pass", "0 cm")], reasons, topics)
    suite = ElementTree.fromstring(report.junit())
    assert suite.findtext("system-out") == (
        f"few < many ({entry_address('overlap')})\nlate ({entry_address('clocks')})"
    )


@pytest.mark.parametrize(
    ("chosen", "code", "element"), [("fail", 3, "failures"), ("skip", 0, "skipped"), ("error", 4, "errors")]
)
def test_what_is_between_is_inconclusive_for_ci(
    chosen: str, code: int, element: str, street: Path, tmp_path: Path
) -> None:
    xml = tmp_path / "a.xml"
    options = ("--max-translation-m", 1e-4, "--junit", xml, "--inconclusive", chosen)
    found = verify(street, street, *options, GITHUB_ACTIONS="true")
    assert found.exit_code == code
    said = " ".join(found.stdout.split())
    assert "Add frames from other places. It would pass with --max-translation-m 0.0" in said
    passing = said.partition("It would pass with ")[2].partition(". ")[0].split()
    assert verify(street, street, *passing).exit_code == 0
    assert "verify::inconclusive; camera centre x " in found.stderr
    (suite,) = junitparser.JUnitXml.fromfile(str(xml))
    assert getattr(suite, element) > 0
    assert suite.errors + suite.failures + suite.skipped == getattr(suite, element)
    passing = next(case for case in suite if case.is_passed)
    assert " degrees, allowed 0.3 degrees" in passing.system_out
    assert passing.time > 0.0


def test_an_error_is_told_to_ci(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A drive that is not there: an `<error>` in JUnit, an annotation; files that are something else stay."""
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    xml = tmp_path / "a.xml"
    code, _, stderr = run(capfd, "verify", tmp_path / "no", tmp_path / "no.yaml", "--junit", xml)
    assert code == 1
    line = f"{tmp_path / 'no.yaml'}: no such file or folder"
    assert stderr.splitlines() == [f"semcal: error: {line}", f"::error title=semcal verify::{line}"]
    (suite,) = junitparser.JUnitXml.fromfile(str(xml))
    assert (suite.tests, suite.errors) == (1, 1)
    (case,) = suite
    assert case.result[0].message == line
    mine = tmp_path / "mine.txt"
    mine.write_text("mine")
    assert run(capfd, "verify", tmp_path / "no", tmp_path / "no.yaml", "--junit", mine)[0] == 1
    assert mine.read_text() == "mine"


def test_figures_for_github(street: Path, street_truth: Pose, tmp_path: Path) -> None:
    """Annotations carry figures, and each reason once; the summary of the job has a table."""
    given = write_transform(turned(street_truth, 1.0), street, tmp_path)
    github = {"GITHUB_ACTIONS": "true", "GITHUB_STEP_SUMMARY": str(tmp_path / "summary.md")}
    found = verify(street, given, **github)
    assert found.exit_code == FAIL
    (annotation,) = re.findall(r"^::error title=semcal verify::(.*)$", found.stderr, re.MULTILINE)
    assert re.search(r"rotation y -?[01]\.\d{3} ± 0\.0\d{2} degrees, allowed 0\.3 degrees", annotation)
    summary = (tmp_path / "summary.md").read_text()
    assert "### semcal verify: fail" in summary
    assert re.search(r"^\| rotation y \| .* allowed 0\.3 degrees \| fail \|$", summary, re.MULTILINE)
    compared = invoke("compare", street, given, env=github)
    assert compared.exit_code == FAIL
    assert (
        "::error title=semcal compare::fail; rotation 1.0 degrees, interval unknown, allowed 0.3"
        in compared.stderr
    )
    assert summary in (tmp_path / "summary.md").read_text()
    assert "### semcal compare: fail" in (tmp_path / "summary.md").read_text()


def test_the_action_names_options_that_exist() -> None:
    folder = Path(__file__).parents[1] / ".github"
    action = yaml.safe_load((folder / "actions/verify/action.yml").read_text())
    script = action["runs"]["steps"][1]
    known = {option for parameter in semcal.commands["verify"].params for option in parameter.opts}
    assert set(re.findall(r"--[a-z-]+", script["run"])) <= known
    assert "${{" not in script["run"]
    assert {name.lower().replace("_", "-") for name in script["env"]} == set(action["inputs"]) - {"install"}
    workflow = yaml.safe_load((folder / "workflows/verify-demo.yml").read_text())
    (used,) = [
        step for step in workflow["jobs"]["verify"]["steps"] if step.get("uses") == "./.github/actions/verify"
    ]
    assert set(used["with"]) <= set(action["inputs"])


def test_data_that_cannot_decide(street: Path, drive: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for path in (drive / "point_labels").iterdir():
        rng.permutation(np.fromfile(path, np.uint32)).tofile(path)
    page, xml = tmp_path / "v.html", tmp_path / "v.xml"
    found = verify(
        drive, street, "--report", page, "--junit", xml, GITHUB_STEP_SUMMARY=str(tmp_path / "v.md")
    )
    assert found.exit_code == INCONCLUSIVE, found.output
    assert re.fullmatch(r"verdict +inconclusive: \d reasons?, see above", found.stdout.splitlines()[-1])
    lines = found.stdout.splitlines()[:8]
    assert all(line.endswith("not judged") and "±" not in line for line in lines)
    assert page.read_text().count('<td class="mark">not judged</td>') == 8
    assert '<rect class="interval"' not in page.read_text()
    (suite,) = junitparser.JUnitXml.fromfile(str(xml))
    assert (suite.tests, suite.errors, suite.failures, suite.skipped) == (1, 1, 0, 0)
    assert "| fail |" not in (tmp_path / "v.md").read_text()
    document = json.loads(verify(drive, street, "--json", "--junit", xml, "--inconclusive", "skip").stdout)
    assert {(check["verdict"], check["half_width"]) for check in document["checks"]} == {
        ("inconclusive", None)
    }
    (suite,) = junitparser.JUnitXml.fromfile(str(xml))
    assert (suite.tests, suite.errors, suite.failures, suite.skipped) == (1, 0, 0, 1)
    assert verify(drive, tmp_path / "nowhere.yaml").exit_code == 1


def test_a_camera_far_from_the_lidar_is_verified_with_a_larger_limit(street: Path, tmp_path: Path) -> None:
    wide = ("--max-rotation-deg", "1", "--max-translation-m", "0.2")
    held = verify(street, street, *wide, "--max-baseline-m", "0.2")
    assert held.exit_code == INCONCLUSIVE, held.output
    assert "the limit of --max-baseline-m" in " ".join(held.stdout.split())
    assert verify(street, street, *wide, "--max-baseline-m", "5").exit_code == PASS


def test_the_inverse_is_named_although_the_clocks_are_in_doubt(
    drive: Path, street_truth: Pose, tmp_path: Path
) -> None:
    with edited(drive) as document:
        del document["synchronization"]
    found = verify(drive, write_transform(inverse(street_truth), drive, tmp_path), "--json")
    report = json.loads(found.stdout)
    assert (found.exit_code, report["topics"]) == (INCONCLUSIVE, ["looks-like", "untied-clocks"])
    assert report["reasons"][0].startswith("this looks like the inverse, T_lidar_camera: correct ")


def test_the_inverse_is_named(street: Path, street_truth: Pose, tmp_path: Path) -> None:
    given, page = write_transform(inverse(street_truth), street, tmp_path), tmp_path / "v.html"
    found = verify(street, given, "--report", page, GITHUB_ACTIONS="true")
    assert found.exit_code == FAIL, found.output
    link = f'<a href="{entry_address(LOOKS_LIKE)}">why this comes up</a>'
    mistake = f"this looks like the inverse, T_lidar_camera: correct {given}"
    assert f"<li>{mistake} ({link})</li>" in page.read_text()
    assert "this looks like the inverse, T_lidar_camera" in found.stdout
    assert "this looks like the inverse, T_lidar_camera" in found.stderr
    assert "find out what moved it" not in found.stdout
    matrix = tmp_path / "matrix.txt"
    np.savetxt(matrix, street_truth)
    said = verify(street, matrix, "--direction", "camera-to-lidar").stdout
    assert "run again with --direction lidar-to-camera" in " ".join(said.split())


def test_mistakes_are_recognised() -> None:
    T = make_pose((0.9, -1.1, 0.4), (0.4, -0.3, 0.2))
    optical = np.eye(4)
    optical[:3, :3] = OPTICAL_AXES  # p_body = OPTICAL_AXES p_optical
    x, y, z, w = quaternion_xyzw(T)
    millimetres = T.copy()
    millimetres[:3, 3] *= 1000.0
    mistakes = {
        "the inverse": inverse(T),
        "T_body_lidar": optical @ T,
        "T_lidar_body": inverse(optical @ T),
        "w x y z that was read as x y z w": pose_from_quaternion((w, x, y, z), T[:3, 3].tolist()),
        "x y z w that was read as w x y z": pose_from_quaternion((y, z, w, x), T[:3, 3].tolist()),
        "millimetres": millimetres,
    }
    for name, given in mistakes.items():
        (line,) = likely_mistakes(given, T)
        assert name in line
    assert likely_mistakes(turned(T, 1.0), T) == []
    assert likely_mistakes(turned(T, 30.0), T) == []


def test_compare(street: Path, street_truth: Pose, made: Path, tmp_path: Path) -> None:
    result = made / "c.yaml"
    compare = invoke("compare", result, street, "--json")
    assert compare.exit_code == PASS, compare.output
    report = json.loads(compare.stdout)
    assert report["same"] is True
    assert all(axis["half_width_a"] > 0.0 and axis["half_width_b"] is None for axis in report["axes"])
    both = invoke("compare", result, result)
    assert both.stdout.count("explained") == 6
    far = write_transform(moved(street_truth, 0.06), street, tmp_path)
    assert "-0.0000" not in both.stdout
    assert re.search(
        r"^verdict +pass: rotation 0\.0+ ± \S+ degrees, allowed 0\.3 degrees;$", both.stdout, re.M
    )
    beyond = invoke("compare", result, far)
    assert beyond.exit_code == FAIL
    last = beyond.stdout.splitlines()[-1]
    assert re.fullmatch(r"verdict +fail: camera centre 6\.\d+ ± 0\.\d+ cm, allowed 5 cm", last)
    assert "more than both" not in both.stdout
    assert max(map(len, f"{both.stdout}{beyond.stdout}".splitlines())) <= 80
    record = read_calibration(result)
    doubted = record.model_copy(update={"status": "not_trusted", "reasons": ("why",), "topics": ("rivals",)})
    write_calibration(doubted, tmp_path / "doubted.yaml")
    shown = invoke("compare", tmp_path / "doubted.yaml", result)
    assert [line.count("not known") for line in shown.stdout.splitlines()[1:7]] == [1] * 6
    assert "explained" not in shown.stdout
    terminal = {"FORCE_COLOR": "1", "NO_COLOR": "", "TERM": "xterm"}
    for other, colour in ((result, GREEN), (far, RED)):
        colourful = invoke("compare", result, other, env=terminal, color=True)
        lines = colourful.stdout.splitlines()
        (start,) = (number for number, line in enumerate(lines) if "verdict" in line)
        assert [line.startswith(colour) for line in lines] == [
            number >= start for number in range(len(lines))
        ]
    allowed = ["compare", result, far, "--max-translation-m", "0.1"]
    assert invoke(*allowed).exit_code == PASS


def test_a_matrix_of_no_stated_direction_is_verified_with_one(
    street: Path, street_truth: Pose, tmp_path: Path
) -> None:
    path = tmp_path / "T.txt"
    np.savetxt(path, np.linalg.inv(street_truth))
    arguments = ["verify", street, path, "-q"]
    refused = invoke(*arguments)
    assert str(refused.exception) == (
        f"{path}: found a transform without a stated direction; add --direction lidar-to-camera "
        "(p_camera = T p_lidar) or camera-to-lidar"
    )
    found = invoke(*arguments, "--direction", "camera-to-lidar")
    assert found.exit_code == PASS, found.output


@pytest.mark.parametrize("value", [-1.0, 1e308])
def test_intervals_of_a_damaged_calibration_are_refused(
    street: Path, made: Path, tmp_path: Path, value: float
) -> None:
    path, document = tmp_path / "calibration.yaml", read_document(made / "c.yaml")
    document["uncertainty"]["half_width_95_camera_center_m"][0] = value
    write_text(document_text(document, "yaml"), path)
    found = invoke("compare", path, street, "--json")
    assert isinstance(found.exception, InputError)
    assert "uncertainty.half_width_95_camera_center_m[0]: found " in str(found.exception)


def test_what_a_drive_would_have_shown(street: Path, street_truth: Pose, tmp_path: Path) -> None:
    """A move that is smaller than the limit is more than chance, and is said to be, where it decides nothing."""
    limits = ("--max-rotation-deg", 0.15, "--max-translation-m", 0.03)
    given = write_transform(turned(street_truth, 0.15), street, tmp_path)
    found = verify(street, given, *limits, "--json")
    report = json.loads(found.stdout)
    assert report["has_moved"]
    assert max(report["smallest_visible"]["rotation_deg"]) < 0.15
    assert report["verdict"] != "pass"
    text = " ".join(verify(street, given, *limits).stdout.split())
    assert re.search(
        r"the smallest errors that these frames would have shown: [\d., ]+ cm along x, y, z, [\d., ]+ degrees",
        text,
    )
    assert not json.loads(verify(street, write_transform(street_truth, street, tmp_path), "--json").stdout)[
        "has_moved"
    ]


def test_errors_of_k_count_where_the_transform_belongs_to_another_k(
    street: Path, street_truth: Pose, tmp_path: Path
) -> None:
    invoke("calibrate", street, "--init", street, "-o", tmp_path / "same.yaml", "-q")
    record = read_calibration(tmp_path / "same.yaml")
    K = np.array(record.input.camera.K)
    K[0, 0] += 0.5
    camera = record.input.camera.model_copy(update={"K": tuple(map(tuple, K.tolist()))})
    other = record.model_copy(update={"input": record.input.model_copy(update={"camera": camera})})
    write_calibration(other, tmp_path / "other.yaml")
    document = read_document(street / DRIVE_FILE)
    del document["camera"]["intrinsics_sigma"]
    for frame in document["frames"]:
        frame |= {key: str(street / path) for key, path in frame.items() if isinstance(path, str)}
    write_text(document_text(document, "yaml"), tmp_path / DRIVE_FILE)
    same, different = (
        json.loads(verify(tmp_path, tmp_path / f"{name}.yaml", "--json").stdout) for name in ("same", "other")
    )
    (note,) = (note for note in different["notes"] if note.startswith("K is not that of the transform: fx "))
    assert note.endswith("the intervals include errors of K")
    assert note not in same["notes"]
    of_both = [max(check["half_width"] for check in report["checks"][4:]) for report in (same, different)]
    assert of_both[1] > 1.2 * of_both[0]


def test_axes_come_first_where_they_alone_decide() -> None:
    """A limit is written as it is, beside offsets that are far larger; enough is one that all axes are within."""
    checks = judge((0.0, 0.0, 0.002), (90.0, 0.0, 0.0), (0.062, 0.025, 0.043, 0.09, 0.2, 0.3), Limits())
    center = [check for check in checks if check.unit == "cm"]
    assert [check.verdict for check in center] == ["inconclusive", "pass", "pass", "pass"]
    assert overall_offsets(center) == [
        "camera centre x off by 0.0 +- 6.2 cm, allowed 5 cm",
        "camera centre off by 0.2 +- 4.3 cm, allowed 5 cm",
    ]
    assert sufficient_limits(checks) == ["--max-translation-m 0.053"]
    turned = replace(checks[-1], half_width=None)
    assert figures(turned) == "90 degrees, interval unknown, allowed 0.3 degrees"
