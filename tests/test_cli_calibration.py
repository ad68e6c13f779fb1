"""What `calibrate`, `refine` and `initialize` write and say of a drive, through the real command."""

import io
import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from conftest import Cli, edited
from laboratory.raw_drive import RawDrive, write_raw_drive
from scipy.spatial.transform import Rotation
from test_calibration import make_calibration

from semcal_cli.cli import EXIT_FAILURE
from semcal_cli.cli.outputs import EXIT_NOT_TRUSTED
from semcal_cli.cli.tables import shown_reasons
from semcal_cli.drive.document import read_drive
from semcal_cli.files.documents import read_document
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import OPTICAL_AXES, camera_center, compare_poses, inverse
from semcal_cli.observations.cues.cue_table import choose_frames
from semcal_cli.result.calibration_document import CalibrationDocument, read_calibration, write_calibration

NOT_LABELLED = 0
"""The id that synthetic drives ignore."""


def texts_under(lines: list[str], label: str) -> list[str]:
    """The texts under a label of a summary, each put together again from its lines."""
    texts: list[str] = []
    is_inside = False
    for line in lines:
        head, text = line[:17].strip(), line[17:]
        is_inside = head == label or (is_inside and not head)
        if head == label:
            texts.append(text)
        elif is_inside:
            texts[-1] += f" {text}"
    return texts


def test_a_mounting_measured_by_hand_narrows_or_replaces_the_search(
    street: Path, street_truth: Pose, tmp_path: Path, cli: Cli
) -> None:
    T_lidar_camera = inverse(street_truth)
    body = T_lidar_camera[:3, :3] @ OPTICAL_AXES.T
    rpy = Rotation.from_matrix(body).as_euler("xyz", degrees=True) + 5.0
    numbers = [f"{x:.1f}" for x in (*rpy, *T_lidar_camera[:3, 3])]
    for extra in ([], ["--search-deg", "15"]):
        output = tmp_path / "out.yaml"
        code, _, _ = cli("initialize", street, "--init-rpy-xyz", *numbers, *extra, "-o", output, "-q")
        assert code == 0
        calibration = read_calibration(output)
        assert compare_poses(calibration.pose, street_truth).rotation_deg < 1.0
        assert calibration.settings.options["given"] == "--init-rpy-xyz " + " ".join(
            repr(float(x)) for x in numbers
        )


def test_calibrate_then_compare(street: Path, street_truth: Pose, tmp_path: Path, cli: Cli) -> None:
    result = tmp_path / "calibration.yaml"
    code, out, err = cli("calibrate", street, "-o", result, "-q")
    assert (code, out) == (0, "")
    assert re.fullmatch(r"verdict trusted: .*\n", err), err
    assert read_calibration(result).status == "trusted"
    error = compare_poses(read_calibration(result).pose, street_truth)
    assert error.rotation_deg < 0.2
    assert error.camera_center_cm < 5.0
    code, out, _ = cli("compare", result, street, "--json")
    assert (code, json.loads(out)["error"]["rotation_deg"]) == (0, error.rotation_deg)


def test_an_answer_that_is_not_trusted_is_written_with_its_reason(
    drive: Path, street_truth: Pose, tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only points within five degrees of the optical axis are labelled, a hundredth of the image."""
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    for path in (drive / "points").iterdir():
        points = np.fromfile(path, np.float32).reshape(-1, 4)[:, :3]
        is_near = points @ street_truth[2, :3] > np.cos(np.radians(5.0)) * np.linalg.norm(points, axis=1)
        labels = drive / "point_labels" / f"{path.stem}.label"
        np.where(is_near, np.fromfile(labels, np.uint32), NOT_LABELLED).astype(np.uint32).tofile(labels)
    trusted = make_calibration(street_truth).model_copy(update={"status": "trusted", "reasons": ()})
    write_calibration(trusted, tmp_path / "out.yaml")
    code, _, stderr = cli("initialize", drive, "--init", drive, "-o", tmp_path / "out.yaml")
    calibration = read_calibration(tmp_path / "out.yaml")
    assert (code, calibration.status, calibration.topics) == (EXIT_NOT_TRUSTED, "not_trusted", ("overlap",))
    annotation = f"::error title=semcal initialize::fail; not_trusted 1 doubt; {calibration.reasons[0]}"
    *lines, last = stderr.splitlines()
    assert last == annotation.replace("%", "%25")
    assert texts_under(lines, "doubt") == [*calibration.reasons]
    assert lines[-5] == f"written to       {tmp_path / 'out.yaml'} in the place of a trusted calibration"
    assert lines[-4] == "verdict          not trusted: 1 doubt, see above"
    assert re.fullmatch(
        r"visible points with classes cover \d\.\d% of the image \(limit 3%\): label more points, or "
        "check which ids the drive ignores",
        calibration.reasons[0],
    )


def test_a_runner_up_that_is_close_is_not_trusted(drive: Path, tmp_path: Path, cli: Cli) -> None:
    """Each sweep is doubled by its own half turn, so that two opposite mountings explain the images alike."""
    for path in (drive / "points").iterdir():
        cloud = np.fromfile(path, np.float32).reshape(-1, 4)
        np.concatenate([cloud, cloud * np.float32([-1.0, -1.0, 1.0, 1.0])]).tofile(path)
    for path in (drive / "point_labels").iterdir():
        path.write_bytes(2 * path.read_bytes())
    code, _, _ = cli("initialize", drive, "-o", tmp_path / "out.yaml", "-q")
    assert code == EXIT_NOT_TRUSTED
    (reason,) = read_calibration(tmp_path / "out.yaml").reasons
    assert re.fullmatch(
        r"a mounting \d+ degrees away explains the labels only \d\.\d\d standard errors worse; a trusted pose must "
        r"beat every other by 2: add frames from other places, or measure the mounting by hand and give "
        r"it with --init-rpy-xyz",
        reason,
    )


def refine(drive: Path, result: Path, cli: Cli, *options: str) -> tuple[CalibrationDocument, str]:
    """Refine from the reference: what is written, and standard error."""
    code, _, err = cli("refine", drive, "--init", drive, "-o", result, *options)
    calibration = read_calibration(result)
    assert code == (EXIT_NOT_TRUSTED if calibration.status == "not_trusted" else 0)
    return calibration, err


def test_what_the_polish_did_is_told(street: Path, tmp_path: Path, cli: Cli) -> None:
    polished, err = refine(street, tmp_path / "out.yaml", cli)
    assert polished.polish is not None
    assert polished.polish.accepted
    assert polished.status == "trusted"
    assert list(polished.stages) == ["initial", "refined", "polished"]
    assert re.search(r"polished +\d+\.\d\d s   moved \d\.\d{3} degrees and \d\.\d\d cm, kept$", err, re.M)
    plain, _ = refine(street, tmp_path / "out.yaml", cli, "--no-polish")
    assert plain.polish is None
    assert plain.status == "not_assessed"
    assert list(plain.stages) == ["initial", "refined"]
    np.testing.assert_allclose(plain.pose, plain.stages["refined"].T_camera_lidar, atol=1e-12)


def test_a_polish_that_held_out_data_reject_is_undone(drive: Path, tmp_path: Path, cli: Cli) -> None:
    """Labels of the frames that are worked with are some pixels to the side, those of the held-out frames are not."""
    with edited(drive) as document:
        document["frames"] = frames = [dict(document["frames"][index]) for index in (0, 1, 2, 3, 0, 1)]
        for index in (0, 1, 3, 4):
            image = cv2.imread(str(drive / frames[index]["image_labels"]), cv2.IMREAD_UNCHANGED)
            frames[index]["image_labels"] = f"image_labels/moved_{index}.png"
            cv2.imwrite(str(drive / frames[index]["image_labels"]), np.roll(image, 3 + index // 4, axis=1))
    rejected, err = refine(drive, tmp_path / "out.yaml", cli)
    assert rejected.polish is not None
    assert not rejected.polish.accepted
    assert rejected.status == "not_trusted"
    assert any(
        reason.startswith("the polish was rejected; held-out data agree ") for reason in rejected.reasons
    )
    assert re.search(r"polished +\d+\.\d\d s   not better, so the previous pose is kept$", err, re.M)
    assert "there are doubts about the pose" in err
    assert texts_under(err.splitlines(), "doubt") == shown_reasons(rejected.reasons, rejected.topics)
    plain, _ = refine(drive, tmp_path / "out.yaml", cli, "--no-polish")
    np.testing.assert_allclose(rejected.pose, plain.pose, atol=1e-12)


def test_a_drive_with_a_wrong_focal_length_is_not_trusted(
    long_street: RawDrive, tmp_path: Path, cli: Cli
) -> None:
    drive = write_raw_drive(long_street, tmp_path).parent
    with edited(drive) as document:
        for row in range(2):
            document["camera"]["K"][row][row] *= 1.1
    code, _, _ = cli("calibrate", drive, "-o", tmp_path / "out.yaml", "-q")
    calibration = read_calibration(tmp_path / "out.yaml")
    assert (code, calibration.status) == (EXIT_NOT_TRUSTED, "not_trusted")
    (reason,) = (reason for reason in calibration.reasons if "the focal length looks wrong" in reason)
    advised = re.search(r", or calibrate with (--refine-intrinsics) ([a-z0-9,]+)$", reason)
    assert advised is not None, reason
    code, _, _ = cli("calibrate", drive, *advised.groups(), "-o", tmp_path / "out.yaml", "-q")
    calibration = read_calibration(tmp_path / "out.yaml")
    assert (code, calibration.status) == (0, "trusted"), calibration.reasons


def test_what_is_known_is_weighed_and_said(
    street: Path, street_truth: Pose, tmp_path: Path, cli: Cli
) -> None:
    result = tmp_path / "out.yaml"
    center = [f"{x:.4f}" for x in camera_center(street_truth)]
    options = ["--init", street, "--fix", "ty,rz", "--prior-translation-m", *center, "0.001"]
    code, _, err = cli("calibrate", street, *options, "-o", result)
    calibration = read_calibration(result)
    assert (code, calibration.status) == (0, "trusted"), err
    assert list(calibration.stages) == ["initial", "refined", "polished", "fused"]
    assert (
        f"--prior-translation-m {' '.join(f'{float(x):g}' for x in center)} 0.001, --fix ty,rz"
        in " ".join(err.split())
    )
    error = compare_poses(calibration.pose, street_truth)
    assert abs(error.camera_center_xyz_cm[1]) < 1e-6
    assert abs(error.rotation_xyz_deg[2]) < 1e-6
    assert calibration.uncertainty is not None
    assert max(calibration.uncertainty.sigma_camera_center_m) < 0.0011
    assert calibration.uncertainty.sigma_rotation_deg[2] < 1e-5
    _, about = calibration.settings.options["priors"]
    assert about["sigma_camera_center_m"] == [None, 0.0, None]
    assert about["sigma_rotation_deg"] == [None, None, 0.0]


def test_an_image_that_is_not_drawn_need_not_be_there(street: Path, tmp_path: Path, cli: Cli) -> None:
    used = {frame.points for frame in choose_frames(read_drive(street), ("labels",), 2).frames}
    with edited(street, tmp_path) as document:
        for frame in document["frames"]:
            is_used = frame["points"] in used
            frame |= {key: str(street / name) for key, name in frame.items()}
            frame["image"] = frame["image"] if is_used else "nowhere.png"
    outputs = ("-o", tmp_path / "c.yaml", "--report", tmp_path / "r.html")
    arguments = ("calibrate", tmp_path, "--init", street, *outputs)
    assert cli(*arguments, "--max-frames", "2")[0] in (0, 3)
    code, _, err = cli(*arguments)
    assert (code, "nowhere.png: no such file" in err) == (1, True)


def test_a_calibration_in_the_format_of_another_tool(
    street: Path, street_truth: Pose, tmp_path: Path, cli: Cli
) -> None:
    options = ["--init", street, "--to", "text", "--to-direction", "lidar-to-camera", "-q"]
    code, out, _ = cli("calibrate", street, *options)
    T = np.loadtxt(io.StringIO(out))
    assert code == 0
    assert compare_poses(T, street_truth).rotation_deg < 0.2
    code, out, err = cli("calibrate", street, "--to", "text", "-o", tmp_path / "T.txt")
    assert (code, out) == (EXIT_FAILURE, "")
    assert err.startswith(
        "semcal: error: --to text: this format may hold either direction; add --to-direction "
    )


def test_the_result_as_json_on_standard_output(street: Path, tmp_path: Path, cli: Cli) -> None:
    """The same bytes as those of a JSON file; -o is written as well, in its own format."""
    for command, name in (("calibrate", "c.json"), ("refine", "c.yaml"), ("initialize", "c.yaml")):
        output = tmp_path / name
        code, out, err = cli(command, street, "--init", street, "--json", "-o", output, "-q")
        assert code == 0
        assert err.startswith("verdict ")
        assert read_document(output) == json.loads(out)
        assert name == "c.yaml" or output.read_text() == out
    code, out, _ = cli("initialize", street, "--init", street, "-o", "-", "-q")
    assert (code, yaml.safe_load(out)["T_camera_lidar"]) == (0, read_document(output)["T_camera_lidar"])


def test_a_matrix_of_no_stated_direction_is_a_start_with_one(
    street: Path, street_truth: Pose, tmp_path: Path, cli: Cli
) -> None:
    start = tmp_path / "T.txt"
    np.savetxt(start, inverse(street_truth))
    for command in ("calibrate", "initialize", "refine"):
        code, _, err = cli(command, street, "--init", start)
        assert code == EXIT_FAILURE
        assert err == (
            f"semcal: error: {start}: found a transform without a stated direction; add --init-direction "
            "lidar-to-camera (p_camera = T p_lidar) or camera-to-lidar\n"
        )
    options = ["--init", start, "--init-direction", "camera-to-lidar", "--json", "-q"]
    code, out, _ = cli("refine", street, *options)
    assert code == 0
    found = json.loads(out)
    assert found["settings"]["options"]["init_direction"] == "camera-to-lidar"
    assert compare_poses(np.array(found["T_camera_lidar"]), street_truth).rotation_deg < 0.2
    code, _, err = cli("refine", street, "--init", street, "--init-direction", "camera-to-lidar")
    assert code == EXIT_FAILURE
    assert err == (
        "semcal: error: --init-direction: found 'camera-to-lidar', but semcal files state it themselves or have none; "
        "leave it out\n"
    )
    options[1], options[3] = street, "lidar-to-camera"
    assert cli("refine", street, *options)[0] == 0  # what the file says, too


@pytest.mark.parametrize("command", ["initialize", "refine"])
def test_figures_for_experts_are_on_request(street: Path, tmp_path: Path, cli: Cli, command: str) -> None:
    said = {}
    for option in ("--log", "--verbose"):
        given = [option, tmp_path / "log.json"] if option == "--log" else [option]
        code, _, said[option] = cli(command, street, "--init", street, "-o", tmp_path / "c.yaml", *given)
        assert code == 0
        assert all(len(line) <= 80 for line in said[option].splitlines() if "/" not in line)
    for word in ("nats", "MI ", "agree with their pixels", "turned by 5 deg"):
        assert word not in said["--log"]
        assert word in said["--verbose"]
    if command != "initialize":
        assert "held out" not in said["--log"]
        assert "held out" in " ".join(said["--verbose"].split())
    lines = said["--log"].splitlines()
    assert lines[-4 if command != "initialize" else -2].startswith("verdict          ")


def test_other_seeds_lead_to_the_same_place(street: Path, tmp_path: Path, cli: Cli) -> None:
    result = tmp_path / "out.yaml"
    code, _, err = cli("calibrate", street, "--repeat", "2", "-o", result)
    calibration = read_calibration(result)
    found, stated = calibration.repeatability, calibration.uncertainty
    assert found is not None
    assert stated is not None
    assert (code, found.num_seeds, found.num_failed) == (0, 2, 0)
    assert "2 seeds          camera centre right, down, forward" in err
    assert found.spread_camera_center_m is not None
    assert max(found.spread_camera_center_m) > 0.0
    assert found.farthest_camera_center_m < min(stated.half_width_95_camera_center_m)


def test_parts_of_a_drive_differ_as_their_intervals_predict(street: Path, tmp_path: Path, cli: Cli) -> None:
    result = tmp_path / "out.yaml"
    code, _, err = cli("calibrate", street, "--cross-validate", "2", "-o", result)
    found = read_calibration(result).cross_validation
    assert found is not None
    assert found.pulls is not None
    assert (code, found.num_folds, found.num_failed) == (0, 2, 0)
    assert 0.0 < max(found.pulls) < 4.0
    assert "2 parts          camera centre right, down, forward" in err
    code, _, err = cli("calibrate", street, "--cross-validate", "9", "-o", result)
    assert code == 1
    assert (
        "--cross-validate: found 4 scenes, needed at least 9, one for each part, of the frames that are used"
        in " ".join(err.split())
    )


def test_a_long_drive_is_cut_to_the_frames_that_differ(drive: Path, tmp_path: Path, cli: Cli) -> None:
    with edited(drive) as document:
        document["frames"] = [dict(document["frames"][0]) for _ in range(3)] + document["frames"]
    result = tmp_path / "out.yaml"
    code, _, err = cli("refine", drive, "--init", drive, "--max-frames", "4", "-o", result)
    calibration = read_calibration(result)
    assert code == 0
    assert "4 of 7 frames" in err
    assert [frame.points for frame in calibration.input.frames] == [f"points/{i:06d}.bin" for i in range(4)]
    assert sum("/0" in name for name in calibration.input.sha256) == 3 * 4  # the files of the frames used
