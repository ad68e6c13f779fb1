"""`semcal audit`: which camera is off, in which axis and since which drive, on the page and elsewhere."""

import json
import os
import re
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from commands import invoke
from conftest import edited, make_pose

from semcal_cli.config import CalibrationConfig, Limits
from semcal_cli.drive.document import read_drive
from semcal_cli.files.documents import read_document
from semcal_cli.geometry.arrays import Pose
from semcal_cli.many.audit.audit_page import audit_page_html
from semcal_cli.many.audit.audited_drives import AuditedCamera, AuditedDrive, group_by_camera
from semcal_cli.many.batch.tasks import Outcome, failed_outcome
from semcal_cli.pipeline.verdict import judge, together
from semcal_cli.pipeline.verification import Verification
from semcal_cli.result.uncertainty import PoseChange

DAY_S = 86_400.0
FIRST_S = 1.7e9
LIMITS = Limits()
WIDTHS = [0.01] * 3 + [0.05] * 3
"""Half widths of 95 % intervals far below the limits, metres and degrees."""


def audited(
    name: str, yaw_deg: float, widths: Sequence[float] = WIDTHS, day: int = 0, pitch_deg: float = 0.0
) -> AuditedDrive:
    """A drive whose delivered calibration is off in yaw, and perhaps in pitch."""
    checks = judge([0.0, 0.0, 0.0], [pitch_deg, yaw_deg, 0.0], widths, LIMITS)
    smallest = PoseChange(camera_center_m=(0.02,) * 3, rotation_deg=(0.1,) * 3)
    verdict = together(check.verdict for check in checks)
    verification = Verification(verdict, checks, (), (), (), np.eye(4), 0.0, verdict == "fail", smallest)
    code = {"pass": 0, "fail": 3, "inconclusive": 4}[verdict]
    outcome = Outcome(
        drive=name, status=verdict, exit_code=code, reasons=(), stamp=FIRST_S + day * DAY_S, result=name
    )
    return AuditedDrive(outcome, verification)


def untrusted(name: str) -> AuditedDrive:
    """A drive whose estimate is not trusted, as `verify` describes it: its offsets have no intervals."""
    checks = judge([0.4, 0.0, 0.0], [0.0, 7.77, 0.0], None, LIMITS)
    reasons, topics = ("the frames show 1 place",), ("few-scenes",)
    verification = Verification("inconclusive", checks, reasons, topics, (), np.eye(4), 0.0, None, None)
    outcome = Outcome(
        drive=name, status="inconclusive", exit_code=4, reasons=reasons, topics=topics, result=name
    )
    return AuditedDrive(outcome, verification)


def camera_of(*drives: AuditedDrive) -> AuditedCamera:
    (camera,) = group_by_camera(drives, {}, dict.fromkeys((drive.name for drive in drives), "front")).cameras
    return camera


@pytest.mark.parametrize(
    ("yaws_deg", "sentence"),
    [
        ((0.0, 0.0, 0.6, 0.6), "holds until b and is off since c, there by 0.600"),
        ((0.6, 0.0, 0.6, 0.6), "holds in b and is off since c, there by 0.600"),
        ((0.6, 0.6), "is off in 2 drives of the 2 that show it, first in a by 0.600"),
        ((0.6,), "is off in a by 0.600"),
        ((0.0, 0.6, 0.0), "is off in 1 drive of the 3 that show it, first in b by 0.600"),
    ],
)
def test_since_when_an_axis_is_off(yaws_deg: tuple[float, ...], sentence: str) -> None:
    camera = camera_of(*(audited("abcd"[i], yaw, day=i) for i, yaw in enumerate(yaws_deg)))
    (said,) = camera.sentences
    assert said.startswith(f"rotation y {sentence}")
    assert said.endswith("and holds again in c") == (yaws_deg[-1] == 0.0)
    assert said.endswith("; it was also off in 1 earlier drive") == (yaws_deg[:2] == (0.6, 0.0))
    assert [departure.axis for departure in camera.departures] == [
        "rotation y"
    ]  # and not the total beside it


def test_a_total_is_named_where_no_axis_explains_it() -> None:
    """In the second drive yaw and pitch are each within the limit, and together beyond it."""
    camera = camera_of(audited("a", 0.6), audited("b", 0.25, pitch_deg=0.25))
    assert camera.drives[1].verdict == "fail"
    assert [departure.axis for departure in camera.departures] == ["rotation y", "rotation overall"]
    assert camera.sentences[1].startswith("rotation is off in 2 drives of the 2 that show it")


def test_drives_that_show_nothing_do_not_date_a_departure() -> None:
    """The third drive is off, but its interval allows that it is not; the name is later than the stamp."""
    vague = audited("a_last_by_name", 0.3, [0.01] * 3 + [3.0] * 3, day=2)
    camera = camera_of(audited("z", 0.0, day=1), vague, untrusted("y"), audited("x", 0.6, day=3))
    assert camera.order == "name"  # one has no stamp
    camera = camera_of(audited("z", 0.0, day=1), vague, audited("x", 0.6, day=3))
    assert (camera.order, [drive.name for drive in camera.drives]) == ("stamp", ["z", "a_last_by_name", "x"])
    (departure,) = camera.departures
    assert (departure.since.name, departure.before.name, len(departure.drives)) == ("x", "z", 2)


def test_figures_that_are_not_trusted_are_not_shown(street: Path) -> None:
    found = group_by_camera([untrusted("drive"), AuditedDrive(failed_outcome("b", "no file"), None)], {}, {})
    assert found.verdict == "fail"
    assert found.title == "1 of 2 drives could not be verified"
    page = audit_page_html(found, {"drive": read_drive(street)}, LIMITS, CalibrationConfig())
    table = page.partition('<section id="cameras">')[2].partition("</section>")[0]
    assert "the frames show 1 place (" in table
    assert "no file" in table
    assert not re.search(r"7\.77|&plusmn;|±|seen from", table.partition("<table>")[2])
    check = found.document["cameras"][1]["drives"][0]["checks"][0]
    assert check["half_width"] is None


def copied(street: Path, folder: Path, T: Pose, day: int, camera: str = "") -> Path:
    """Copy a drive with another reference and stamps, and perhaps a camera's name."""
    shutil.copytree(street, folder)
    with edited(folder) as document:
        document["T_camera_lidar"] = T.tolist()
        document |= {"frame_ids": {"camera": camera}} if camera else {}
        for number, frame in enumerate(document["frames"]):
            frame["points_stamp"] = frame["image_stamp"] = FIRST_S + day * DAY_S + number
    return folder


def test_the_command(
    street: Path, street_truth: Pose, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One camera is turned by a degree from the second day on; the names are not in the order of the days."""
    monkeypatch.chdir(tmp_path)
    turned = make_pose((0.0, np.radians(1.0), 0.0), (0.0, 0.0, 0.0)) @ street_truth
    for name, T, day in (("drives/b", street_truth, 0), ("drives/a", turned, 1)):
        copied(street, Path(name), T, day)
    Path("drives/broken").mkdir()
    Path("drives/broken/drive.yaml").write_text("semcal_drive: 1\n")
    arguments = ("audit", "drives", "-o", "audit.html", "--results", "kept", "--junit", "audit.xml")
    first = invoke(*arguments)
    assert first.exit_code == 1, first.output
    lines = first.stdout.splitlines()
    assert lines[0] == "verdict          fail: the calibration of 1 of 2 cameras is off"
    said = " ".join(first.stdout.split())
    assert (
        "fail camera of drives/b rotation y holds until drives/b and is off since drives/a, there by" in said
    )
    assert "not verified drives/broken:" in said
    page = Path("audit.html").read_text()
    assert page.index("<h1>The calibration of 1 of 2 cameras is off</h1>") < page.index("<table>")
    assert page.count('<figure id="frame-') == 1
    assert "delivered left of the line, found on this drive right of it" in page
    assert "://" not in re.sub(r'href="[^"]*"', "", page)
    assert 'failures="2"' in Path("audit.xml").read_text()
    kept = read_document(Path("kept/drives/a/verification.json"))
    assert json.loads(json.dumps(Verification.of_document(kept).document)) == kept
    again = invoke(*arguments[:-2], "--json", "-q")
    camera = json.loads(again.stdout)["cameras"][0]
    assert camera["departures"][0]["since"] == "drives/a"
    assert camera["departures"][0]["since_stamp"] == FIRST_S + DAY_S
    assert [drive["verdict"] for drive in camera["drives"]] == ["pass", "fail"]


def test_cameras_are_told_apart(street: Path, street_truth: Pose, tmp_path: Path) -> None:
    """By name, or else by intrinsics and about where they are delivered to be."""
    beside = make_pose((0.0, 0.0, 0.0), (0.54, 0.0, 0.0)) @ street_truth
    stated = {"a": (street_truth, ""), "b": (beside, ""), "c": (street_truth, "left"), "d": (beside, "left")}
    documents = {
        name: read_drive(copied(street, tmp_path / name, T, 0, camera))
        for name, (T, camera) in stated.items()
    }
    drives = [audited(name, 0.0) for name in [*stated, "e"]]
    found = group_by_camera(drives, documents, {"e": "left"})
    groups = {camera.name: [drive.name for drive in camera.drives] for camera in found.cameras}
    assert groups == {"camera of a": ["a"], "camera of b": ["b"], "left": ["c", "d", "e"]}


@pytest.mark.parametrize("name", ["a", "z"])
def test_a_drive_without_a_pose_joins_the_only_camera_that_it_may_be_of(
    name: str, street: Path, street_truth: Pose, tmp_path: Path
) -> None:
    """It must not join both cameras of a stereo pair, wherever its name stands."""
    beside = make_pose((0.0, 0.0, 0.0), (0.54, 0.0, 0.0)) @ street_truth
    documents = {
        each: read_drive(copied(street, tmp_path / each, T, 0))
        for each, T in (("l", street_truth), ("r", beside), (name, street_truth))
    }
    documents[name] = documents[name].model_copy(update={"T_camera_lidar": None})

    def groups(*names: str) -> list[list[str]]:
        found = group_by_camera([audited(each, 0.0) for each in names], documents, {})
        return sorted(sorted(drive.name for drive in camera.drives) for camera in found.cameras)

    assert groups(*sorted(("l", "r", name))) == sorted([["l"], ["r"], [name]])
    assert groups(*sorted(("l", name))) == [sorted(("l", name))]


def broken_rig(rig: Path, tmp_path: Path) -> Path:
    """Copy a rig with broken drives, so that none is verified for long."""
    broken = shutil.copytree(rig.parent, tmp_path / "rig")
    for file in broken.glob("*/drive.yaml"):
        file.write_text("semcal_drive: 1\n")
    return broken


def test_a_drive_of_a_rig_is_audited_once(rig: Path, tmp_path: Path) -> None:
    broken = broken_rig(rig, tmp_path)
    relative = os.path.relpath(broken)
    done = invoke("audit", relative, broken / "camera_1", "-o", tmp_path / "audit.html", "--json", "-q")
    cameras = json.loads(done.stdout)["cameras"]
    assert [(camera["camera"], len(camera["drives"])) for camera in cameras] == [
        ("camera_0", 1),
        ("camera_1", 1),
    ]


@pytest.mark.parametrize("name", ["rig/rig.yaml", "list.txt", "rig/camera_0/drive.yaml", "drive/{image}"])
def test_nothing_that_is_read_is_overwritten(name: str, rig: Path, street: Path, tmp_path: Path) -> None:
    broken_rig(rig, tmp_path)
    shutil.copytree(street, tmp_path / "drive")
    (tmp_path / "list.txt").write_text(f"{tmp_path / 'rig'}\n{tmp_path / 'drive'}\n")
    file = tmp_path / name.format(image=read_drive(street).frames[0].image)
    before = file.read_bytes()
    done = invoke("audit", tmp_path / "list.txt", "-o", tmp_path / "audit.html", "--junit", file)
    message = f"{file}: found a file that this run reads or writes; choose another name"
    assert (str(done.exception), file.read_bytes()) == (message, before)


def test_the_page_names_an_image_that_is_missing(street: Path, street_truth: Pose, tmp_path: Path) -> None:
    documents = {name: read_drive(copied(street, tmp_path / name, street_truth, 0, "front")) for name in "ab"}
    frames = documents["a"].frames
    image = documents["a"].resolve(frames[len(frames) // 2].image or "")
    image.unlink()
    found = group_by_camera([audited(name, 0.6) for name in "ab"], documents, {})
    page = audit_page_html(found, documents, LIMITS, CalibrationConfig())
    assert page.count('<figure id="frame-') == 1
    assert f"<h3>a</h3>\n  <p>Not shown: {image}: " in page
    alone = group_by_camera([audited("a", 0.6)], documents, {})
    assert "Not shown: " in audit_page_html(alone, documents, LIMITS, CalibrationConfig())


def test_a_rig_that_is_wrong_is_a_line(rig: Path, tmp_path: Path) -> None:
    folder = broken_rig(rig, tmp_path)
    wrong = tmp_path / "wrong"
    wrong.mkdir()
    (wrong / "rig.yaml").write_text("semcal_rig: 1\n")
    done = invoke("audit", folder, wrong, "-o", tmp_path / "audit.html", "--json", "-q")
    drives = [drive for camera in json.loads(done.stdout)["cameras"] for drive in camera["drives"]]
    assert {drive["verdict"] for drive in drives} == {"not verified"}
    assert len(drives) == 3
    (reason,) = next(drive["reasons"] for drive in drives if drive["drive"] == str(wrong))
    assert reason.startswith(f"{wrong}/rig.yaml: cameras: ")


def test_the_cameras_of_a_rig_are_named(rig: Path, tmp_path: Path) -> None:
    done = invoke("audit", broken_rig(rig, tmp_path), "-o", tmp_path / "audit.html", "--json", "-q")
    assert done.exit_code == 1
    assert [camera["camera"] for camera in json.loads(done.stdout)["cameras"]] == ["camera_0", "camera_1"]


def test_a_page_needs_its_suffix(street: Path, tmp_path: Path) -> None:
    done = invoke("audit", street, "-o", tmp_path / "audit.yaml")
    assert done.exit_code == 1
    assert str(done.exception) == f"{tmp_path / 'audit.yaml'}: found suffix '.yaml', expected .html"
