"""Several cameras of one LiDAR: what one camera's pose beside another's is known to, and the command."""

import dataclasses
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from click.testing import Result
from commands import invoke
from conftest import NAMES, SMALL, make_pose
from rigs import copy_rig, exp, run, twist, with_pose
from robots import robot

from semcal_cli.drive.document import read_drive
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.files import point_clouds
from semcal_cli.files.documents import read_document
from semcal_cli.geometry.poses import inverse
from semcal_cli.geometry.twists import adjoint
from semcal_cli.many.rig.rig_document import find_rig, read_rig
from semcal_cli.many.rig.rig_pair import Reference, make_pair
from semcal_cli.observations.reading import read_label_images
from semcal_cli.result.calibration_document import read_calibration
from semcal_cli.synthetic.synthesis import synthesize, synthesize_rig


def test_the_adjoint_carries_a_twist_over() -> None:
    T, xi = make_pose((0.4, -1.0, 2.0), (0.3, -0.5, 1.1)), np.array([0.3, -0.2, 0.1, 0.2, 0.4, -0.3])
    assert T @ exp(xi) == pytest.approx(exp(adjoint(T) @ xi) @ T, abs=1e-12)


def test_the_covariance_of_a_pair_is_that_of_its_scatter(rig_results: tuple[Result, Path]) -> None:
    """Both cameras are moved as their covariances say; the pair scatters as its own does."""
    rng = np.random.default_rng(4)
    cameras = [read_calibration(rig_results[1] / f"{name}.yaml") for name in NAMES]
    poses = [make_pose((0.3, -0.2, 0.1), (0.4, -0.2, 0.7)), make_pose((-0.8, 0.4, 1.0), (2.0, 0.3, -0.4))]
    covariances = [root @ root.T for root in 1e-3 * rng.standard_normal((2, 6, 6))]
    a, b = map(with_pose, cameras, poses, covariances)
    pair = make_pair("a", a, "b", b)
    draws = [rng.multivariate_normal(np.zeros(6), covariance, 20_000) for covariance in covariances]
    T_a, T_b = (exp(xi) @ T for xi, T in zip(draws, poses, strict=True))
    errors = twist(T_a @ np.linalg.inv(T_b) @ inverse(pair.T_a_b))
    assert pair.uncertainty is not None
    covariance = np.array(pair.uncertainty.covariance)
    scale = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    assert np.cov(errors.T) / scale == pytest.approx(covariance / scale, abs=0.03)
    # Known no better than either camera alone would tell, and no worse than by both.
    degrees = [
        dof for camera in cameras if camera.uncertainty for dof in camera.uncertainty.degrees_of_freedom
    ]
    of_pair = np.array(pair.uncertainty.degrees_of_freedom)
    assert ((min(degrees) <= of_pair) & (of_pair <= sum(degrees))).all()


def test_a_pair_is_compared_with_its_reference(rig_results: tuple[Result, Path]) -> None:
    a, b = (read_calibration(rig_results[1] / f"{name}.yaml") for name in NAMES)
    T = a.pose @ inverse(b.pose)
    near, far = T.copy(), T.copy()
    far[0, 3] += 1.0
    for stated, is_explained in ((near, True), (far, False)):
        pair = make_pair("a", a, "b", b, Reference(stated, "a file"))
        assert pair.is_explained is is_explained
    assert pair.error is not None
    assert pair.error.camera_center_cm == pytest.approx(100.0)
    assert pair.believed_uncertainty == pair.uncertainty
    doubted = b.model_copy(update={"status": "not_trusted", "reasons": ("why",)})
    pair = make_pair("a", a, "b", doubted, Reference(near, "a file"))
    assert pair.uncertainty is not None
    assert (pair.believed_uncertainty, pair.is_explained) == (None, None)


def test_a_rig_is_calibrated_as_its_cameras_are_alone(rig: Path, rig_results: tuple[Result, Path]) -> None:
    """The same bytes, and each sweep is read once."""
    found, out = rig_results
    assert found.exit_code in (0, 3), found.output
    document = read_document(out / "rig_calibration.yaml")
    assert document["num_sweeps"] == SMALL.num_frames
    assert list(document["cameras"]) == list(NAMES)
    alone = rig.parents[1] / "alone"
    alone.mkdir()
    for name in NAMES:
        run(rig.parent / name, "-o", alone / f"{name}.yaml")
        assert (alone / f"{name}.yaml").read_bytes() == (out / f"{name}.yaml").read_bytes()
    (pair,) = document["pairs"]
    assert (pair["a"], pair["b"]) == NAMES
    T_0, T_1 = (np.array(document["cameras"][name]["T_camera_lidar"]) for name in NAMES)
    assert np.array(pair["T_a_b"]) == pytest.approx(T_0 @ inverse(T_1), abs=1e-12)
    assert pair["reference"]["source"] == "T_camera_lidar of both drives"
    assert pair["reference"]["rotation_deg"] < 0.5
    assert list(json.loads((rig.parents[1] / "log.json").read_text())) == list(NAMES)
    assert "T_camera_0_camera_1" in found.stderr


def test_each_sweep_is_read_once(rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read = []
    original = point_clouds.read_point_clouds

    def counting(files: list[tuple[Path, Path | None]], *others: Any) -> Any:
        read.extend(files)
        return original(files, *others)

    monkeypatch.setattr(point_clouds, "read_point_clouds", counting)
    result = run(rig, "-o", tmp_path / "out", "--no-polish", "--max-frames", "2")
    assert result.exit_code in (0, 3), result.output
    assert 2 <= len(read) == len({points.resolve() for points, _ in read}) <= SMALL.num_frames
    document = read_document(tmp_path / "out/rig_calibration.yaml")
    assert document["num_sweeps"] == len(read)
    assert f"{len(read)} for 4 frames" in result.stderr


@pytest.mark.parametrize(
    "text",
    [
        "\ufeffsemcal_rig: 1\ncameras: {a: a, b: b}\n",
        "{semcal_rig: 1, cameras: {a: a, b: b}}",
        '{"cameras": {"a": "a", "b": "b"}, "semcal_rig": 1}',
        "# ours\n'semcal_rig' : 1\ncameras: {a: a, b: b}\n",
    ],
)
def test_a_rig_is_known_by_its_content(text: str, tmp_path: Path) -> None:
    file = tmp_path / "r.json" if text.startswith('{"') else tmp_path / "r.yaml"
    file.write_text(text)
    assert f"{tmp_path}/a: no such file" in str(run(file, "-o", tmp_path / "out").exception)


def test_other_commands_want_the_drive_of_one_camera(rig: Path, tmp_path: Path) -> None:
    for path in (rig, rig.parent):
        result = invoke("initialize", path, "-o", tmp_path / "initial.yaml")
        assert str(result.exception) == (
            f"{rig}: found a rig, which only `semcal calibrate`, `verify`, `inspect`, `report` and `overlay` accept, "
            "expected the drive of one of its cameras"
        )


def test_a_rig_without_its_key_is_told_what_a_rig_is(tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text("cameras: [left_drive, right_drive]\n")
    assert str(invoke("calibrate", tmp_path / "rig.yaml").exception) == (
        f"{tmp_path / 'rig.yaml'}: found no key semcal_rig, expected a rig such as {{semcal_rig: 1, cameras: {{left: "
        "left_drive, right: right_drive}}"
    )


def test_cameras_of_a_synthetic_rig_err_in_places_of_their_own(tmp_path: Path) -> None:
    """Same sweeps, and the same camera twice: their wrong labels differ."""
    config = dataclasses.replace(SMALL, num_frames=1, label_noise=0.3)
    synthesize(config, tmp_path / "a")
    synthesize(config, tmp_path / "b", sweeps="../a", camera=1)
    images = [read_label_images(read_drive(tmp_path / name))[0] for name in ("a", "b")]
    clean = dataclasses.replace(config, label_noise=0.0)
    synthesize(clean, tmp_path / "clean")
    truth = read_label_images(read_drive(tmp_path / "clean"))[0]
    wrong = [image != truth for image in images]
    assert np.mean(wrong[0] & wrong[1]) == pytest.approx(np.mean(wrong[0]) * np.mean(wrong[1]), rel=0.1)


def test_a_camera_that_fails_stops_no_other(rig: Path, tmp_path: Path) -> None:
    copy_rig(rig, tmp_path, dict(zip(NAMES, NAMES, strict=True)))
    shutil.rmtree(tmp_path / "camera_0/image_labels")
    result = run(tmp_path, "-o", tmp_path / "out", "--no-polish")  # the folder of a rig.yaml
    assert isinstance(result.exception, CalibrationError)
    assert str(result.exception).startswith("1 of 2 cameras failed; camera_0: ")
    document = read_document(tmp_path / "out/rig_calibration.yaml")
    assert document["status"] == document["cameras"]["camera_0"]["status"] == "failed"
    assert document["cameras"]["camera_1"]["status"] == "not_assessed"
    assert read_calibration(tmp_path / "out/camera_1.yaml").status == "not_assessed"
    assert not (tmp_path / "out/camera_0.yaml").exists()


def test_a_reference_is_taken_either_way_round(rig: Path) -> None:
    T = make_pose((0.3, -0.2, 0.1), (0.4, -0.2, 0.7))
    document = yaml.safe_load(rig.read_text()) | {"T_camera_camera": {"camera_1": {"camera_0": T.tolist()}}}
    path = rig.with_name("with_reference.yaml")
    path.write_text(yaml.safe_dump(document))
    read = read_rig(path)
    assert read.reference("camera_1", "camera_0") == pytest.approx(T)
    assert read.reference("camera_0", "camera_1") == pytest.approx(inverse(T))


IDENTITY = np.eye(4).tolist()


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"cameras": {"front": "camera_0"}}, "cameras: found a mapping of 1, needed at least 2"),
        ({"cameras": {"front": "camera_0", "a/b": "camera_1"}}, "expected a camera name of letters"),
        (
            {"cameras": {"front": "camera_0", "Front": "camera_1"}},
            "expected names that differ in more than case",
        ),
        (
            {"cameras": {"a": "camera_0", "b": "camera_0/drive.yaml"}},
            "for 'a' and 'b', expected a drive for each",
        ),
        ({"cameras": {"a": "camera_0", "b": "none"}}, "none: no such file"),
        ({"camera": {}}, "unknown key 'camera'; the nearest known key is 'cameras'"),
        ({"T_camera_camera": {"camera_0": {"left": IDENTITY}}}, "found camera 'left', expected one of"),
        ({"T_camera_camera": {"camera_0": {"camera_0": IDENTITY}}}, "found 'camera_0' under itself"),
        (
            {"T_camera_camera": {"camera_0": {"camera_1": IDENTITY}, "camera_1": {"camera_0": IDENTITY}}},
            "in both directions, expected one of them",
        ),
        (
            {"T_camera_camera": {"camera_0": {"camera_1": [[1, 2], [3, 4]]}}},
            "T_camera_camera.camera_0.camera_1",
        ),
        ({"semcal_rig": 2}, "semcal_rig: found 2"),
        ({"cameras": {"a": "camera_0", "Rig_Calibration": "camera_1"}}, "expected a name that differs from"),
    ],
)
def test_mistakes_are_named(rig: Path, changes: dict, complaint: str, tmp_path: Path) -> None:
    path = rig.with_name("wrong.yaml")
    path.write_text(json.dumps(yaml.safe_load(rig.read_text()) | changes))
    result = run(path, "-o", tmp_path / "out")
    assert isinstance(result.exception, InputError), result.output
    assert complaint in str(result.exception)
    assert not (tmp_path / "out").exists()


def test_usage(rig: Path, tmp_path: Path) -> None:
    team = tmp_path / "team.yaml"
    team.write_text("semcal_options: 1\ncalibrate: {init-rpy-xyz: [0, 0, 0, 0, 0, 0]}\n")
    for options in (
        [],
        ["--frames", "0:2"],
        ["--to", "tum"],
        ["--json"],
        ["--image-model", "m"],
    ):
        result = run(rig, *(["-o", tmp_path] if options else []), *options)
        assert result.exit_code == 2
        message = f"Error: {options[0]} is for one camera, but {rig} is a rig." if options else "Error: -o: "
        assert message in result.output
    of_file = run(rig, "-o", tmp_path, "--config", team)
    assert f"--init-rpy-xyz is for one camera, but {rig} is a rig. {team} states some" in of_file.output
    assert "expected a folder" in str(run(rig, "-o", tmp_path / "out.yaml").exception)
    # Results would replace a drive of the rig.
    for name in NAMES:
        (tmp_path / f"{name}.yaml").write_text((rig.parent / name / "drive.yaml").read_text())
    document = {"semcal_rig": 1, "cameras": {name: f"{name}.yaml" for name in NAMES}}
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(document))
    assert "reads or writes" in str(run(tmp_path / "rig.yaml", "-o", tmp_path).exception)


def test_drives_of_another_lidar_are_no_rig(rig: Path, tmp_path: Path) -> None:
    path = copy_rig(rig, tmp_path, dict(zip(NAMES, NAMES, strict=True)))
    drive = tmp_path / "camera_1/drive.yaml"
    drive.write_text(drive.read_text().replace("channels: 32", "channels: 64"))
    complaint = (
        "found different `lidar` blocks in the drives of 'camera_0' and 'camera_1', expected the same LiDAR"
    )
    with pytest.raises(InputError, match=complaint):
        read_rig(path).read_drives()


def test_a_drive_that_speaks_of_a_rig_is_a_drive(rig: Path, tmp_path: Path) -> None:
    drive = tmp_path / "drive.yaml"
    text = (rig.parent / "camera_0/drive.yaml").read_text()
    drive.write_text(f"# of a rig,\n# semcal_rig: 1\n{text}# {{semcal_rig: 1\n")
    assert find_rig(drive) is None
    assert find_rig(tmp_path) is None


def test_cameras_that_share_no_clouds_are_no_rig(tmp_path: Path) -> None:
    """Two cameras share clouds; two others share others."""
    for name, seed in (("rig", 5), ("other", 6)):
        synthesize_rig(dataclasses.replace(SMALL, num_frames=1, seed=seed), 2, tmp_path / name)
    drives = [f"{folder}/{camera}" for folder in ("rig", "other") for camera in NAMES]
    cameras = dict(zip(("front", "rear", "left", "right"), drives, strict=True))
    path = tmp_path / "rig.yaml"
    path.write_text(yaml.safe_dump({"semcal_rig": 1, "cameras": cameras}))
    assert str(run(path, "-o", tmp_path / "out").exception) == (
        f"{path}: cameras: found no cloud of 'left' and 'right' among those of 'front' and 'rear', "
        "expected drives that name the same clouds, or `constraints` between them: the cameras of a rig share one LiDAR"
    )
    assert not (tmp_path / "out").exists()


def test_copies_of_a_cloud_are_one_cloud(rig: Path, tmp_path: Path) -> None:
    """One cloud of three is enough, and it may have another name."""
    path = copy_rig(rig, tmp_path, {"front": "camera_0", "rear": "camera_0"})
    cloud = tmp_path / "rear/points/000001.bin"
    for other in (0, 2):
        altered = np.fromfile(cloud.with_name(f"00000{other}.bin"), np.float32)[:-4] + 0.01
        altered.tofile(cloud.with_name(f"00000{other}.bin"))
    cloud.rename(cloud.with_name("renamed.bin"))
    drive = tmp_path / "rear/drive.yaml"
    drive.write_text(drive.read_text().replace("points/000001.bin", "points/renamed.bin"))
    assert list(read_rig(path).read_drives()) == ["front", "rear"]
    (tmp_path / "rear/points/renamed.bin").write_bytes(b"another cloud")
    with pytest.raises(InputError, match="found no cloud of 'rear' among those of 'front'"):
        read_rig(path).read_drives()


def test_a_camera_may_be_connected_through_another(rig: Path, tmp_path: Path) -> None:
    names = dict.fromkeys(("a", "b", "c"), "camera_0")
    path = copy_rig(rig, tmp_path, names)
    for name, frames in (("a", (0, 1)), ("b", (2,)), ("c", (1, 2))):
        drive = tmp_path / name / "drive.yaml"
        document = yaml.safe_load(drive.read_text())
        drive.write_text(
            yaml.safe_dump(document | {"frames": [document["frames"][index] for index in frames]})
        )
    assert list(read_rig(path).read_drives()) == list(names)


def test_clouds_that_are_missing_are_left_to_their_own_camera(rig: Path, tmp_path: Path) -> None:
    path = copy_rig(rig, tmp_path, {"front": "camera_0", "rear": "camera_0"})
    shutil.rmtree(tmp_path / "rear/points")
    assert list(read_rig(path).read_drives()) == ["front", "rear"]


def with_frames(rig: Path, folder: Path) -> tuple[Path, Path]:
    """Copy a rig whose drives name their frames and state no transform, and write a URDF that states both."""
    shutil.copytree(rig.parent, folder)
    cameras = {}
    for name in NAMES:
        file = folder / name / "drive.yaml"
        document = read_document(file)
        names = {"lidar": "top", "camera": f"{name}_optical_frame"}
        cameras[names["camera"]] = np.array(document.pop("T_camera_lidar"))
        file.write_text(yaml.safe_dump({**document, "frame_ids": names}))
    (folder / "robot.urdf").write_text(robot("top", cameras))
    return folder, folder / "robot.urdf"


def test_a_robot_description_gives_each_camera_its_own_start(rig: Path, tmp_path: Path) -> None:
    """Each drive's `frame_ids` name its camera among those of the file, also for one drive alone."""
    folder, urdf = with_frames(rig, tmp_path / "rig")
    out = tmp_path / "out"
    result = run(folder, "--init", urdf, "-o", out, "--no-polish", "--cue", "labels")
    assert result.exit_code in (0, 3), result.output
    for name in NAMES:
        truth = np.array(read_drive(rig.parent / name).T_camera_lidar)
        initial = np.array(read_calibration(out / f"{name}.yaml").stages["initial"].T_camera_lidar)
        assert initial == pytest.approx(truth, abs=1e-6)
    again = run(folder, "--init", out, "-o", tmp_path / "again", "--no-polish", "--cue", "labels")
    assert f"camera_1: --init {out}/camera_1.yaml" in " ".join(again.stderr.split())
    one = run(folder / NAMES[1], "--init", urdf, "-o", tmp_path / "one.yaml", "--no-polish")
    assert one.exit_code in (0, 3), one.output
    batch = invoke("batch", folder / NAMES[1], "-o", tmp_path / "batch", "--", "--init", urdf, "--no-polish")
    assert batch.exit_code in (0, 3), batch.output
    limits = ("--max-rotation-deg", 0.5, "--json", "-q")
    for drive in (folder, folder / NAMES[1]):
        assert json.loads(invoke("verify", drive, urdf, *limits).stdout)["verdict"] == "pass"


def test_a_given_start_of_a_rig_is_not_replaced(
    rig: Path, rig_results: tuple[Result, Path], tmp_path: Path
) -> None:
    folder, urdf = with_frames(rig, tmp_path / "rig")
    results = tmp_path / "results"
    shutil.copytree(rig_results[1], results)
    before = {path: path.read_bytes() for path in (urdf, *results.iterdir())}
    for words in (
        ("--init", urdf, "-o", tmp_path / "out", "--log", urdf),
        ("--init", results, "-o", results),
    ):
        assert "found a file that this run reads or writes" in str(run(folder, *words).exception)
    assert all(path.read_bytes() == content for path, content in before.items())


def test_a_file_of_one_camera_is_no_start_of_a_rig(
    rig: Path, rig_results: tuple[Result, Path], tmp_path: Path
) -> None:
    one = rig_results[1] / "camera_0.yaml"
    for result in (run(rig, "--init", one, "-o", tmp_path / "out"), invoke("verify", rig, one)):
        assert str(result.exception) == (
            f"{one}: found one transform for camera_0 and camera_1, expected one for each, by the `frame_ids` of its "
            "drive, or the results of a rig"
        )
    drive = rig.parent / "camera_0"
    assert str(run(rig, "--init", drive, "-o", tmp_path / "out").exception) == (
        f"{drive}: found no rig_calibration.yaml, expected the results of a rig, or a file that names the frames of "
        "all its sensors, such as a URDF"
    )
    assert not (tmp_path / "out").exists()
