"""A camera and a clock that were estimated with a pose: every command that takes the result uses them, and says so."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from click.testing import Result
from commands import invoke, unwrapped
from conftest import NAMES, edited
from refined import GIVEN_S, LATER_S, clock, of_another_drive, refined_camera, spoiled, with_camera

import semcal_cli
from semcal_cli.cli.tables import summary_lines
from semcal_cli.drive.camera import Camera
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.stated_motion import Motion
from semcal_cli.observations.loading import load
from semcal_cli.report import read_report_input
from semcal_cli.report.view.server import ViewServer
from semcal_cli.report.view.session import Session
from semcal_cli.report.words import camera_sentences, uncertainty_sentences
from semcal_cli.result.applied import apply_result, as_begun
from semcal_cli.result.calibration_document import CalibrationDocument, read_calibration, write_calibration
from semcal_cli.result.next_steps import after_calibration
from semcal_cli.result.provenance import camera_hash
from semcal_cli.result.refined_camera import camera_differences

PASS, FAIL, INCONCLUSIVE = 0, 3, 4
INDENT = 17
"""Columns before the texts of the terminal's lines."""


def with_K(folder: Path, K: Any, **changes: Any) -> None:
    """Write another K into the drive.yaml of a folder."""
    with edited(folder) as document:
        document["camera"] |= {"K": [list(row) for row in K], **changes}


@pytest.fixture
def right(street: Path) -> Camera:
    return read_drive(street).camera


@pytest.fixture
def wrong_drive(drive: Path, right: Camera) -> Path:
    """A drive whose focal lengths are 3 % wrong."""
    with_K(drive, spoiled(right).K)
    return drive


@pytest.fixture
def record(made: Path, right: Camera) -> CalibrationDocument:
    """What a calibration of that drive says that has found the right ones."""
    return of_another_drive(with_camera(read_calibration(made / "c.yaml"), spoiled(right), right))


@pytest.fixture
def file(record: CalibrationDocument, tmp_path: Path) -> Path:
    write_calibration(record, tmp_path / "c.yaml")
    return tmp_path / "c.yaml"


def said(right: Camera, file: Path) -> str:
    pairs = zip(("fx", "fy"), (right.K[0][0], right.K[1][1]), strict=True)
    figures = ", ".join(f"{name} {value:.6g} (drive: {1.03 * value:.6g})" for name, value in pairs)
    return f"camera           that of {file}: {figures}\n"


def unwrapped_errors(found: Result) -> str:
    return unwrapped(found.stderr, INDENT)


def test_verify_uses_the_camera_of_the_result(
    wrong_drive: Path, file: Path, made: Path, right: Camera, tmp_path: Path
) -> None:
    """The same transform does not pass where only the wrong camera is known."""
    page = tmp_path / "v.html"
    found = invoke("verify", wrong_drive, file, "--report", page)
    assert found.exit_code == PASS, found.output
    assert said(right, file) in unwrapped_errors(found)
    assert f"The camera is that of {file}, estimated together with the transform." in page.read_text()
    assert invoke("verify", wrong_drive, file, "-q").stderr == ""
    assert invoke("verify", wrong_drive, made / "c.yaml", "-q").exit_code in (FAIL, INCONCLUSIVE)


def test_verify_in_python_uses_it_also_on_a_drive_that_is_loaded(wrong_drive: Path, file: Path) -> None:
    for drive in (wrong_drive, read_drive(wrong_drive), load(wrong_drive)):
        assert semcal_cli.verify(drive, file).verdict == "pass"


def test_a_batch_of_verifications_uses_it(wrong_drive: Path, file: Path, tmp_path: Path) -> None:
    command = ["batch", wrong_drive, "--command", "verify", "--calibration", file, "-o", tmp_path / "out"]
    assert invoke(*command).exit_code == PASS
    (log,) = (tmp_path / "out").rglob("log.txt")
    assert "camera           that of " in unwrapped(log.read_text(), INDENT)


def test_overlays_are_those_of_the_right_camera(
    wrong_drive: Path, file: Path, made: Path, right: Camera, tmp_path: Path
) -> None:
    found = invoke("overlay", wrong_drive, file, "-o", tmp_path / "with", "--max-frames", 1)
    assert found.exit_code == 0, found.output
    assert unwrapped_errors(found).startswith(said(right, file))
    shutil.copy(made / "c.yaml", file)  # its name stands on the images
    invoke("overlay", wrong_drive, file, "-o", tmp_path / "wrong", "--max-frames", 1)
    with_K(wrong_drive, right.K)
    invoke("overlay", wrong_drive, file, "-o", tmp_path / "right", "--max-frames", 1)
    images = {name: (tmp_path / name / "000000.png").read_bytes() for name in ("with", "right", "wrong")}
    assert images["with"] == images["right"] != images["wrong"]


def test_the_page_shows_the_found_camera(
    wrong_drive: Path, file: Path, right: Camera, tmp_path: Path
) -> None:
    report = read_report_input(read_drive(wrong_drive), file)
    assert report.drive.camera == right
    assert report.is_of_record
    assert not any("camera" in notice for notice in report.notices)
    page = tmp_path / "r.html"
    found = invoke("report", wrong_drive, file, "-o", page)
    assert said(right, file) in unwrapped_errors(found)
    text = page.read_text()
    assert "kept: held-out data gain 0.0123 \u00b1 0.0010 nats." in text
    fx = right.K[0][0]
    cells = ("fx", f"{1.03 * fx:.2f} px", f"{fx:.2f} px", "&plusmn; 0.42 px", "yes")
    assert "".join(cells) in re.sub(r"</?td[^>]*>", "", text)
    assert "<td>no, kept as given</td>" in text


def test_each_stage_is_shown_by_the_camera_that_it_was_found_with(
    wrong_drive: Path, file: Path, made: Path, right: Camera
) -> None:
    begun, wrong = read_drive(wrong_drive), spoiled(right)
    report = read_report_input(begun, file)
    first, last = report.overlays(1).views.values()
    assert (first.observations.camera, last.observations.camera) == (wrong, right)
    with_K(wrong_drive, right.K)  # as a user does who starts from it
    first, last = read_report_input(read_drive(wrong_drive), file).overlays(1).views.values()
    assert (first.observations.camera.K, last.observations.camera) == (wrong.K, right)
    first, last = read_report_input(begun, file, made / "c.yaml").overlays(1).views.values()
    assert (first.observations.camera, last.observations.camera) == (wrong, right)
    first, last = read_report_input(begun, made / "c.yaml", file).overlays(1).views.values()
    assert (first.observations.camera, last.observations.camera) == (right, wrong)


def test_a_pose_that_is_shown_beside_another_one_has_its_own_camera(
    wrong_drive: Path, file: Path, made: Path, right: Camera, tmp_path: Path
) -> None:
    """The upper image, or the left one, is that of the drive's camera if its transform belongs to that."""
    beside = tmp_path / "beside.yaml"
    images = []
    for source in (made / "c.yaml", file):
        shutil.copy(source, beside)  # its name stands on the images
        found = invoke(
            "overlay", wrong_drive, file, "--against", beside, "-o", tmp_path / "o", "--max-frames", 1
        )
        assert found.exit_code == 0, found.output
        assert (said(right, beside) in unwrapped_errors(found)) == (source == file)
        images.append(cv2.imread(str(tmp_path / "o" / "000000.png")))
    given, estimated = images
    half = given.shape[1] // 2
    assert (given[:, :half] != estimated[:, :half]).any()
    assert np.array_equal(given[:, half:], estimated[:, half:])


def test_a_camera_that_was_not_kept_is_not_used(
    record: CalibrationDocument, wrong_drive: Path, right: Camera, tmp_path: Path
) -> None:
    rejected = with_camera(record, spoiled(right), right, is_kept=False)
    drive = read_drive(wrong_drive)
    assert apply_result(rejected, drive, "c.yaml") == (drive, ())
    (sentence,) = camera_sentences(rejected)
    assert sentence == (
        "The intrinsics were estimated together with the pose, but not kept: held-out data gain "
        "0.0123 +- 0.0010 nats; the transform belongs to the camera of the drive."
    )


def test_a_camera_of_other_images_is_not_used(
    record: CalibrationDocument, drive: Path, right: Camera
) -> None:
    half = [[value / 2.0 for value in row] for row in right.K[:2]] + [[0.0, 0.0, 1.0]]
    with_K(drive, half, width=right.width // 2, height=right.height // 2)
    small = read_drive(drive)
    applied = apply_result(record, small, "c.yaml")
    assert applied.drive.camera == small.camera
    kind = f"plumb_bob of {right.width} x {right.height} pixels"
    line = f"that of {small.path}: the camera of c.yaml is {kind}"
    assert applied.changes == (("camera", line),)
    late = record.model_copy(update={"clock": clock()})
    applied = apply_result(late, moving(small), "c.yaml")
    assert applied.drive == moving(small)
    own = f"that of {small.path}: images are 5.0 ms later than their stamps say (c.yaml: 23.1 ms)"
    assert applied.changes == (("camera", line), ("clock", own))


def test_a_drive_that_has_the_camera_by_now_is_left_as_it_is(
    record: CalibrationDocument, street: Path
) -> None:
    drive = read_drive(street)
    assert apply_result(record, drive, "c.yaml") == (drive, ())
    assert apply_result(None, drive, "c.yaml") == (drive, ())


def test_a_transform_of_another_camera_is_said_to_be_one(
    wrong_drive: Path, made: Path, right: Camera, tmp_path: Path
) -> None:
    """A result that estimated no camera belongs to the one of its own drive, which stays unused on another drive."""
    plain, file = made / "c.yaml", wrong_drive / "drive.yaml"
    pairs = zip(("fx", "fy"), (right.K[0][0], right.K[1][1]), strict=True)
    figures = ", ".join(f"{name} {1.03 * value:.6g} ({plain}: {value:.6g})" for name, value in pairs)
    line, page = f"camera           that of {file}: {figures}\n", tmp_path / "page.html"
    for command in (("overlay", "-o", tmp_path / "o"), ("verify", "--report", page), ("report", "-o", page)):
        found = invoke(command[0], wrong_drive, plain, *command[1:])
        assert line in unwrapped_errors(found)
        if page in command:
            assert f"The camera is that of {file}: {figures}." in page.read_text()


def test_a_page_says_whose_camera_is_that_of_the_other_transform(
    wrong_drive: Path, file: Path, made: Path, right: Camera, tmp_path: Path
) -> None:
    other = tmp_path / "b.yaml"
    shutil.copy(made / "c.yaml", other)
    found = invoke("report", wrong_drive, other, "--against", file, "-o", tmp_path / "r.html")
    assert said(right, file) in unwrapped_errors(found)
    notice = said(right, file).removeprefix("camera").strip()
    assert f"In the images of {file}, the camera is {notice}." in (tmp_path / "r.html").read_text()


def test_zeros_that_a_lens_ends_with_make_it_no_other_one(right: Camera) -> None:
    shorter, longer, other = (
        right.model_copy(update={"distortion": distortion})
        for distortion in ((0.1, 0.0, 0.0, 0.0), (0.1, 0.0, 0.0, 0.0, 0.0), (0.1, 0.0, 0.0, 0.0, 0.2))
    )
    assert camera_differences(shorter, longer, "B") == []
    assert camera_differences(shorter, other, "B") == ["another distortion"]
    assert camera_hash(shorter) == camera_hash(longer) != camera_hash(other)


def test_an_estimated_camera_is_written_with_the_transform(record: CalibrationDocument) -> None:
    trusted = record.model_copy(update={"status": "trusted"})
    assert ("with its K", "semcal convert c.yaml --to camera-info") in after_calibration(
        trusted, Path("c.yaml")
    )


def moving(drive: Drive) -> Drive:
    return drive.model_copy(update={"motion": Motion(speed_m_s=8.0), "time_offset_s": 0.005})


def test_the_clock_of_the_result_is_used(record: CalibrationDocument, street: Path) -> None:
    drive = moving(read_drive(street))
    given = record.input.model_copy(update={"camera": drive.camera})
    late = record.model_copy(update={"camera": None, "clock": clock(), "input": given})
    applied = apply_result(late, drive, "c.yaml")
    assert applied.drive.time_offset_s == 0.0231
    line = "that of c.yaml: images are 23.1 ms later than their stamps say (drive: 5.0 ms)"
    assert applied.changes == (("clock", line),)
    unknown = late.model_copy(update={"clock": clock(is_determined=False)})
    assert apply_result(unknown, drive, "c.yaml") == (drive, ())
    rejected = clock().model_copy(update={"is_kept": False})
    assert apply_result(late.model_copy(update={"clock": rejected}), drive, "c.yaml") == (drive, ())
    on_time = drive.model_copy(update={"time_offset_s": 0.0})
    line = f"that of {drive.path}: image stamps are right (c.yaml: 5.0 ms)"
    found = apply_result(late.model_copy(update={"clock": rejected}), on_time, "c.yaml")
    assert found == (on_time, (("clock", line),))


def test_stages_are_shown_by_the_clock_that_they_were_found_with(
    record: CalibrationDocument, street: Path
) -> None:
    """Also where the drive has the clock of the result by then; an older file does not tell it."""
    late = record.model_copy(update={"camera": None, "clock": clock()})
    drive = moving(read_drive(street)).model_copy(update={"time_offset_s": LATER_S})
    assert as_begun(late, drive).time_offset_s == GIVEN_S
    for is_older in (
        clock().model_copy(update={"given_s": None}),
        clock().model_copy(update={"is_kept": False}),
    ):
        assert as_begun(late.model_copy(update={"clock": is_older}), drive) == drive


def test_export_uses_it_for_the_poses_that_belong_to_it(
    wrong_drive: Path,
    record: CalibrationDocument,
    file: Path,
    right: Camera,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Those of the result, of the stage that estimated the camera, and of the stages after it."""
    pytest.importorskip("rerun")
    from semcal_cli.report import rerun_file

    later = dict.fromkeys(("joint", "adjusted"), record.stages["polished"])
    write_calibration(record.model_copy(update={"stages": record.stages | later}), file)
    drawn: dict[str, Camera] = {}
    monkeypatch.setattr(rerun_file, "_log_camera", lambda _, name, __, camera: drawn.update({name: camera}))
    found = invoke("export", "rerun", wrong_drive, file, "-o", tmp_path / "a.rrd", "--max-frames", 1)
    assert found.exit_code == 0, found.output
    assert unwrapped_errors(found).startswith(said(right, file))
    assert {"reference", "hypothesis_0", "stage_initial", "stage_polished"} < {*drawn}
    for name in ("stage_joint", "stage_adjusted", "result"):
        assert drawn.pop(name) == right
    assert {camera.K for camera in drawn.values()} == {spoiled(right).K}


def test_compare_says_that_cameras_differ(file: Path, made: Path, right: Camera) -> None:
    same = invoke("compare", file, made / "c.yaml")
    assert "camera  " not in same.stderr
    other = read_calibration(made / "c.yaml")
    given = other.input.model_copy(update={"camera": spoiled(right)})
    write_calibration(other.model_copy(update={"input": given}), file.with_name("b.yaml"))
    found = invoke("compare", file, file.with_name("b.yaml"), "--json")
    assert said(right, file).replace(f"of {file}:", "of A has").replace("drive", "B").replace(
        "has  ", "has "
    ) in (found.stderr)
    json.loads(found.stdout)


# What is printed.


def test_the_summary_lists_intrinsics_and_clock(record: CalibrationDocument, right: Camera) -> None:
    lines = summary_lines(record.model_copy(update={"clock": clock()}))
    fx, fy, cx = right.K[0][0], right.K[1][1], right.K[0][2]
    start = lines.index(f"intrinsics       fx {fx:.2f} ± 0.42 px (drive: {1.03 * fx:.2f})")
    assert lines[start + 1 : start + 5] == [
        f"                 fy {fy:.2f} ± 0.50 px (drive: {1.03 * fy:.2f})",
        f"                 cx not determined: kept at {cx:.6g} px",
        "                 kept: held-out data gain 0.0123 ± 0.0010 nats",
        "clock            images are 23.1 ms later than their stamps say, ±1.2 ms",
    ]


def test_nothing_that_was_determined_is_said_in_words(record: CalibrationDocument, right: Camera) -> None:
    none = refined_camera(right, right, is_kept=False)
    none = none.model_copy(update={"intrinsics": {"cx": none.intrinsics["cx"]}})
    changes = {"camera": none, "clock": clock(is_determined=False)}
    sentences = camera_sentences(record.model_copy(update=changes))
    assert sentences == [
        "The intrinsics were estimated together with the pose, but not kept: the data determine none of them; the "
        "transform belongs to the camera of the drive.",
        "Not determined: drive at different speeds, with turns.",
    ]


def test_intervals_include_what_is_not_known_of_an_estimated_K(record: CalibrationDocument) -> None:
    assert any(
        sentence.endswith(
            "K was estimated together with the pose, and the intervals include its uncertainty."
        )
        for sentence in uncertainty_sentences(record)
    )


def test_view_shows_the_points_as_the_found_camera_sees_them(
    wrong_drive: Path, file: Path, street: Path, right: Camera, monkeypatch: pytest.MonkeyPatch
) -> None:
    def close(server: ViewServer) -> None:
        server.server_close()
        sessions.append(server.session)

    sessions = list[Session]()
    monkeypatch.setattr(ViewServer, "answer_until_ended", close)
    assert unwrapped_errors(invoke("view", wrong_drive, file)).startswith(said(right, file))
    invoke("view", street, file)
    invoke("view", wrong_drive)
    starts = [session.page["start"] for session in sessions]
    assert starts == [read_calibration(file).pose.tolist()] * 2 + [None]
    request = {"base": starts[0], "offsets": [0.0] * 6, "frame": 0}
    shown, as_right, as_wrong = (session.points(request) for session in sessions)
    assert shown == as_right
    assert shown["points"] != as_wrong["points"]


def test_a_rig_is_shown_with_the_cameras_that_were_found(
    rig: Path, rig_results: tuple[Result, Path], tmp_path: Path
) -> None:
    results = tmp_path / "results"
    shutil.copytree(rig_results[1], results)
    (name, other) = NAMES
    known = read_calibration(results / f"{name}.yaml")
    given = known.input.camera
    command = ("overlay", rig, results, "--max-frames", 1, "-o")
    assert invoke(*command, tmp_path / "before").exit_code == 0
    write_calibration(with_camera(known, given, spoiled(given)), results / f"{name}.yaml")
    assert invoke(*command, tmp_path / "after").exit_code == 0
    before, after = (
        {camera: (tmp_path / when / camera / "000000.png").read_bytes() for camera in NAMES}
        for when in ("before", "after")
    )
    assert before[name] != after[name]
    assert before[other] == after[other]
