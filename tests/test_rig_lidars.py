"""Rigs of several LiDARs: their documents, and the commands."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import Result
from commands import invoke
from conftest import LIDAR, NAMES, SMALL_LIDARS
from rigs import exp, with_pose
from test_rig_confirmation import IDENTITY
from test_schemas import check

from semcal_cli import errors
from semcal_cli.cli.jobs import failure_sentence
from semcal_cli.errors import InputError
from semcal_cli.files.documents import read_document
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.geometry.poses import compare_poses, inverse
from semcal_cli.many.rig.adjustment import adjust
from semcal_cli.many.rig.further_lidar import (
    MAX_HALF_WIDTH_DEG,
    assess_lidar,
    first_cameras,
    measure_lidars,
)
from semcal_cli.many.rig.rig_calibration import combine
from semcal_cli.many.rig.rig_document import read_rig
from semcal_cli.many.rig.rig_page import rig_verdict
from semcal_cli.many.rig.sweep_registration import SweepPair, read_sweep_pairs
from semcal_cli.result.calibration_document import read_calibration


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        (
            {"lidars": {"rear": {"cameras": {"back": "camera_0_on_lidar_1"}}}, "T_lidar_lidar": {}},
            "lidars.rear: found nothing that ties it to the first LiDAR, expected a camera that sees both, "
            "`constraints`, or `register: true` and T_lidar_lidar",
        ),
        (
            {"lidars": {"lidar": {"cameras": {"camera_0": "camera_0_on_lidar_1"}}}},
            "lidars: found 'lidar' for two things, expected a name for each camera, LiDAR and result",
        ),
        (
            {"cameras": {"lidar": "camera_0", "camera_1": "camera_1"}},
            "lidars: found 'lidar' for two things, expected a name for each camera, LiDAR and result",
        ),
        (
            {"lidars": {"Camera_0": {"cameras": {"camera_0": "camera_0_on_lidar_1"}}}},
            "lidars: found 'camera_0' and 'Camera_0', expected names that differ in more than case",
        ),
        (
            {"cameras": {"camera_0": "camera_0", "camera_0_on_lidar_1": "camera_1"}},
            "lidars: found 'camera_0_on_lidar_1' for two things, expected a name for each camera, LiDAR and result",
        ),
        (
            {"lidars": {"a/b": {"cameras": {"camera_0": "camera_0_on_lidar_1"}}}},
            "lidars: found 'a/b', expected a LiDAR name of letters, digits, _, - and .",
        ),
        (
            {"lidars": {"lidar_1": {"cameras": {}}}},
            "lidars.lidar_1.cameras: found a mapping of 0, needed at least 1",
        ),
        (
            {"lidars": {"lidar_1": {"cameras": {"camera_0": "camera_1"}}}},
            "for 'camera_1' and 'camera_0_on_lidar_1', expected a drive for each",
        ),
        (
            {"T_lidar_lidar": {"lidar": {"rear": IDENTITY}}},
            "T_lidar_lidar: found LiDAR 'rear', expected one of: lidar, lidar_1",
        ),
        (
            {
                "constraints": [
                    {"from": "rear", "to": "lidar", "T_to_from": IDENTITY, "sigma_m": 1.0, "sigma_deg": 1.0}
                ]
            },
            "constraints[0]: found camera or LiDAR 'rear', expected one of: camera_0, camera_1, lidar, lidar_1",
        ),
        (
            {
                "cameras": {"lidar": "camera_0", "camera_1": "camera_1"},
                "lidars": {},
                "T_lidar_lidar": {},
                "constraints": [
                    {
                        "from": "lidar",
                        "to": "camera_1",
                        "T_to_from": IDENTITY,
                        "sigma_m": 1.0,
                        "sigma_deg": 1.0,
                    }
                ],
            },
            "cameras: found 'lidar', expected another name beside `constraints`",
        ),
        (
            {"cameras": {"camera_0": "camera_0"}, "lidars": {}, "T_lidar_lidar": {}},
            "found a mapping of 1, needed at least 2",
        ),
    ],
)
def test_mistakes_are_named(lidars: Path, changes: dict, complaint: str) -> None:
    path = lidars.with_name("wrong.yaml")
    path.write_text(yaml.safe_dump(yaml.safe_load(lidars.read_text()) | changes))
    with pytest.raises(InputError) as caught:
        read_rig(path).read_drives()
    assert str(caught.value).startswith(f"{path}: ")
    assert complaint in str(caught.value)


def test_drives_of_one_camera_have_one_camera(lidars: Path, tmp_path: Path) -> None:
    path = Path(shutil.copytree(lidars.parent, tmp_path / "rig")) / "rig.yaml"
    drive = path.parent / "camera_1_on_lidar_1/drive.yaml"
    drive.write_text(drive.read_text().replace("width: 480", "width: 490"))
    with pytest.raises(InputError) as caught:
        read_rig(path).read_drives()
    assert str(caught.value) == (
        f"{path}: lidars: found different `camera` blocks in the drives of 'camera_1' and 'camera_1_on_lidar_1', "
        "expected the same camera"
    )


def test_drives_have_sweeps_and_images_of_their_own(lidars: Path, tmp_path: Path) -> None:
    """Drives in wrong places, and copies of drives, would be trusted: their loops close."""
    path = Path(shutil.copytree(lidars.parent, tmp_path / "rig")) / "rig.yaml"
    shutil.copytree(path.parent, path.parent / "copy")
    document = yaml.safe_load(path.read_text())
    for drive, complaint in (
        ("camera_1_on_lidar_1", ".camera_0: found images of 'camera_1', expected those of 'camera_0'"),
        ("copy/camera_1_on_lidar_1", ".camera_0: found images of 'camera_1', expected those of 'camera_0'"),
        (
            "copy/camera_0",
            ": found clouds of 'lidar' in the drive of 'camera_0', expected sweeps of another LiDAR, or "
            "`lidar.own_points` with ranges of one field that do not overlap",
        ),
    ):
        document["lidars"] = {LIDAR: {"cameras": {"camera_0": drive}}}
        path.write_text(yaml.safe_dump(document))
        with pytest.raises(InputError) as caught:
            read_rig(path).read_drives()
        assert str(caught.value) == f"{path}: lidars.{LIDAR}.cameras{complaint}"


def merge_clouds(rig: Path) -> None:
    """Write the points of both LiDARs to the same clouds, with their numbers, by which the drives name them."""
    (rig / "merged").mkdir()
    for camera in NAMES:
        folders = rig / camera, rig / f"{camera}_on_{LIDAR}"
        documents = [yaml.safe_load((folder / "drive.yaml").read_text()) for folder in folders]
        for frames in zip(*(document["frames"] for document in documents), strict=True):
            cloud = rig / "merged" / Path(frames[0]["points"]).name
            rows, labels = [], []
            for number, (folder, frame) in enumerate(zip(folders, frames, strict=True), start=1):
                points = np.fromfile(folder / frame["points"], "<f4").reshape(-1, 4)
                rows.append(np.insert(points, 4, number, axis=1))
                labels.append(np.fromfile(folder / frame["point_labels"], "<u4"))
                frame |= {"points": str(cloud), "point_labels": str(cloud.with_suffix(".label"))}
            np.concatenate(rows).tofile(cloud)
            np.concatenate(labels).tofile(cloud.with_suffix(".label"))
        for number, (folder, document) in enumerate(zip(folders, documents, strict=True), start=1):
            document["point_columns"] = ["x", "y", "z", "intensity", "lidar"]
            (folder / "drive.yaml").write_text(yaml.safe_dump(document))
            state_own_points(folder, "lidar", number, number)


def state_own_points(folder: Path, field: str, *ends: int) -> None:
    document = yaml.safe_load((folder / "drive.yaml").read_text())
    document.setdefault("lidar", {})["own_points"] = {"field": field, "range": [*ends]}
    (folder / "drive.yaml").write_text(yaml.safe_dump(document))


def test_drives_of_two_lidars_may_name_other_points_of_the_same_clouds(lidars: Path, tmp_path: Path) -> None:
    path = Path(shutil.copytree(lidars.parent, tmp_path / "rig")) / "rig.yaml"

    def sweeps() -> list[SweepPair]:
        drives = read_rig(path).read_drives()
        return [*read_sweep_pairs([drives["camera_0"]], [drives[f"camera_0_on_{LIDAR}"]], SweepCache()).pairs]

    apart = sweeps()
    merge_clouds(path.parent)
    merged = sweeps()
    assert len(apart) == len(merged) == SMALL_LIDARS.num_frames
    for pair, merged_pair in zip(apart, merged, strict=True):
        for points, merged_points in zip(pair, merged_pair, strict=True):
            np.testing.assert_array_equal(points, merged_points)
    needed = re.escape(
        "expected sweeps of another LiDAR, or `lidar.own_points` with ranges of one field that"
    )
    for field, *ends in (("lidar", 1, 2), ("intensity", 2, 2)):
        for camera in NAMES:
            state_own_points(path.parent / f"{camera}_on_{LIDAR}", field, *ends)
        with pytest.raises(InputError, match=needed):
            read_rig(path).read_drives()


def test_a_missing_extra_is_named(lidars: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(errors, "is_installed", lambda package: package != "small_gicp")
    result = invoke("calibrate", lidars, "-o", tmp_path / "out")
    assert str(result.exception).startswith(
        f"{lidars}: lidars.lidar_1.register: found no small_gicp; install the extra 'registration': pip install"
    )
    assert not (tmp_path / "out").exists()


def test_the_command_places_the_lidar(
    lidars: Path, lidar_results: tuple[Result, Path], tmp_path: Path
) -> None:
    ending, out = lidar_results
    assert ending.exit_code in (0, 3), ending.output
    document = read_document(out / "rig_calibration.yaml")
    check(lidars)
    check(out / "rig_calibration.yaml")
    lidar = document["lidars"][LIDAR]
    assert (lidar["status"], lidar["registration"]["num_pairs"]) == ("trusted", SMALL_LIDARS.num_frames)
    pair = lidar["pair"]
    assert (pair["a"], pair["b"], pair["reference"]["source"]) == ("lidar", LIDAR, "rig.yaml")
    assert pair["reference"]["is_explained"]
    assert pair["reference"]["rotation_deg"] < 0.05
    assert pair["reference"]["camera_center_cm"] < 1.0
    assert max(pair["uncertainty"]["half_width_95_rotation_deg"]) < 0.1 < MAX_HALF_WIDTH_DEG
    assert list(document["cameras"]) == list(lidar["cameras"]) == list(NAMES)
    loops = document["adjustment"]["loops"]
    assert [loop["sensors"] for loop in loops] == [["lidar", LIDAR, name] for name in NAMES]
    assert f"LiDAR {LIDAR}    trusted: ±" in ending.stderr.replace("+- ", "±")
    assert "T_lidar_lidar_1\n" in ending.stderr
    assert f"lidar - {LIDAR} - camera_0 closes within" in " ".join(ending.stderr.split())
    # What was written is read again.
    again = invoke("report", lidars, out, "-o", tmp_path / "again.html")
    assert again.exit_code == 0, again.output
    assert (tmp_path / "again.html").read_bytes() == out.with_suffix(".html").read_bytes()
    page = (tmp_path / "again.html").read_text()
    assert "p_lidar = T_lidar_lidar_1 p_lidar_1: from lidar_1 to lidar" in page
    assert page.count("chance explains it") == len(loops)


def test_a_wrong_calibration_is_named_and_neither_lidar_nor_rig_is_trusted(
    lidars: Path, lidar_results: tuple[Result, Path], rng: np.random.Generator
) -> None:
    """The registration, which starts between the two cameras, shows which of them is wrong."""
    rig, sound = read_rig(lidars), {"status": "trusted", "reasons": (), "topics": ()}
    drives, truth = rig.read_drives(), rig.reference("lidar", LIDAR)
    cameras = {
        name: read_calibration(lidar_results[1] / f"{name}.yaml").model_copy(update=sound)
        for name in rig.views
    }
    turned = cameras[f"camera_1_on_{LIDAR}"]
    turn = exp(np.array([0.0, 0.0, 0.0, 0.0, np.radians(2.0), 0.0]))
    cameras[f"camera_1_on_{LIDAR}"] = with_pose(turned, turn @ turned.pose, turned.covariance)
    measured = measure_lidars(rig, cameras, drives)
    adjustment, sensors = adjust(first_cameras(rig, cameras), (), measured.ties)
    lidar = assess_lidar(LIDAR, rig, drives, cameras, adjustment, sensors, measured)
    whole = combine(rig, drives, cameras, {}, 6, adjustment, (lidar,))
    (reason,) = whole.reasons
    assert re.match(r"the calibration of camera_1 with lidar_1 is (1\.9|2\.0|2\.1) degrees and ", reason)
    assert reason.endswith(
        "was left out: check the drives of camera_1 with lidar_1 and with the first LiDAR, and the others of its loops"
    )
    assert (whole.status, lidar.status, lidar.reasons) == ("not_trusted", "not_trusted", (reason,))
    assert lidar.pair.believed_uncertainty is None
    assert compare_poses(lidar.pair.T_a_b, truth).rotation_deg < 0.05
    assert [loop.is_explained for loop in adjustment.loops] == [True, False]
    assert rig_verdict(whole).title == "Measurements of the rig contradict each other"
    assert rig_verdict(whole).sentence == "Each camera is trusted alone."
    unknown = cameras["camera_0"].model_copy(update={"status": "not_assessed"})
    whole = combine(rig, drives, cameras | {"camera_0": unknown}, {}, 6, adjustment, (lidar,))
    assert rig_verdict(whole).sentence == "The accuracy of these is unknown: camera_0."


def test_cameras_of_the_further_lidar_alone_are_shown_and_exported(lidars: Path, tmp_path: Path) -> None:
    """Only the second LiDAR sees `camera_1`."""
    document = yaml.safe_load(lidars.read_text()) | {"cameras": {"camera_0": "camera_0"}}
    path, out, page = lidars.with_name("own.yaml"), tmp_path / "out", tmp_path / "page.html"
    path.write_text(yaml.safe_dump(document))
    ending = invoke("calibrate", path, "-o", out, "--report", page)
    assert ending.exit_code in (0, 3), ending.output
    assert "the other measurements of the rig moved the camera by" in " ".join(ending.stderr.split())
    (own,) = read_document(out / "rig_calibration.yaml")["lidars"][LIDAR]["own_cameras"]
    for transform in ("T_camera_1_lidar p_lidar:", "T_camera_1_lidar_1 p_lidar_1:"):
        assert transform in page.read_text()
    file = tmp_path / "rig_config.json"
    done = invoke("export", "colmap", path, out, "-o", file)
    assert done.exit_code == 0, done.output
    (config,) = json.loads(file.read_text())
    assert [entry["image_prefix"] for entry in config["cameras"]] == ["camera_0/", "camera_1/"]
    T = read_calibration(out / "camera_0.yaml").pose @ inverse(np.array(own["T_a_b"]))
    assert config["cameras"][1]["cam_from_rig_translation"] == pytest.approx(inverse(T)[:3, 3].tolist())


@pytest.mark.parametrize(("of_lidars", "kind"), [(True, "calibrations"), (False, "cameras")])
def test_what_failed_is_named(of_lidars: bool, kind: str) -> None:
    sentence = failure_sentence({"front_on_rear": "why"}, 4, of_lidars=of_lidars)
    assert sentence == f"1 of 4 {kind} failed; front_on_rear: why"


def test_rigs_that_would_be_too_large_are_not_synthesized(tmp_path: Path) -> None:
    result = invoke("synth", tmp_path / "rig", "--cameras", "99", "--lidars", "3")
    assert str(result.exception) == (
        "--lidars: found 3 and --cameras 99, expected at most 100 drives with further LiDARs"
    )
    assert not (tmp_path / "rig").exists()


def test_overlays_and_inspection_take_each_camera_with_each_lidar(
    lidars: Path, lidar_results: tuple[Result, Path], tmp_path: Path
) -> None:
    ending = invoke(
        "overlay", lidars, lidar_results[1], "-o", tmp_path / "o", "--by", "depth", "--max-frames", "1"
    )
    assert ending.exit_code == 0, ending.output
    names = [*NAMES, *(f"{name}_on_{LIDAR}" for name in NAMES)]
    assert sorted(path.parent.name for path in (tmp_path / "o").rglob("*.png")) == sorted(names)
    lines = invoke("inspect", lidars).stdout.splitlines()
    assert [line for line in lines if line.startswith("[")] == [f"[{name}]" for name in names]
