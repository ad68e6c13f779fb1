"""Overlapping images of a rig: what they show of its cameras, and cameras that were calibrated to a wrong maximum."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import Result
from commands import invoke
from conftest import make_pose
from rigs import run

from semcal_cli.config import CalibrationConfig
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.document import DRIVE_FILE, Drive, read_drive
from semcal_cli.drive.stated_motion import Motion
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.files.documents import read_document
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses, inverse
from semcal_cli.geometry.twists import apply_twist, displace
from semcal_cli.many.rig.image_matching import fit_all, pair_images
from semcal_cli.many.rig.matched_images import MatchedImages
from semcal_cli.many.rig.relative_pose import RelativePose, fit_relative_pose
from semcal_cli.many.rig.rig_data import RigData
from semcal_cli.many.rig.rig_document import read_rig
from semcal_cli.many.rig.rig_result import read_rig_result
from semcal_cli.many.rig.rig_search import RigImages, RigPlaces, tied_groups
from semcal_cli.result.calibration_document import CalibrationDocument, read_calibration
from semcal_cli.result.uncertainty import Uncertainty
from semcal_cli.synthetic.synthesis import synthesize

AZIMUTHS_DEG = {"front": 0.0, "left": 45.0, "rear": 180.0}
OVERLAPPING = ["front", "left"]
FAR_DEG = 9.0
"""How far the start of a camera is turned, beyond the reach of edges."""


@pytest.fixture(scope="module")
def rig_of_three(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two cameras that overlap and one that looks back, on one LiDAR; tests do not write to it."""
    out = tmp_path_factory.mktemp("overlap")
    config = SynthConfig(num_frames=4, seed=7, width=720, height=405)
    for index, (name, azimuth_deg) in enumerate(AZIMUTHS_DEG.items()):
        mounted = replace(config, rig_seed=40 + index, camera_azimuth_deg=azimuth_deg)
        synthesize(mounted, out / name, sweeps="../front" if index else None, camera=index)
    (out / "rig.yaml").write_text(
        yaml.safe_dump(
            {"semcal_rig": 1, "cameras": {name: name for name in AZIMUTHS_DEG}, "match_images": True}
        )
    )
    return out / "rig.yaml"


@pytest.fixture(scope="module")
def drives(rig_of_three: Path) -> dict[str, Drive]:
    return read_rig(rig_of_three).read_drives()


@pytest.fixture(scope="module")
def truth(drives: dict[str, Drive]) -> dict[str, Pose]:
    return {name: np.array(drive.T_camera_lidar) for name, drive in drives.items()}


@pytest.fixture(scope="module")
def turned_results(rig_of_three: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path]:
    """The rig by edges, where the start of one camera is turned too far."""
    out = tmp_path_factory.mktemp("turned")
    shutil.copytree(rig_of_three.parent, out / "rig")
    file = out / "rig" / "left" / DRIVE_FILE
    document = yaml.safe_load(file.read_text())
    turn = np.radians([0.0, 0.0, 0.0, 0.0, FAR_DEG, 0.0])
    document["T_camera_lidar"] = apply_twist(np.array(document["T_camera_lidar"]), turn).tolist()
    file.write_text(yaml.safe_dump(document))
    return run(out / "rig", "--cue", "edges", "-o", out / "results"), out / "results"


def shown_of(to: str, source: str, T: Pose, sigma_deg: float = 0.1) -> MatchedImages:
    covariance = np.diag(np.repeat([0.01, np.radians(sigma_deg)], 3) ** 2).tolist()
    of_features = {"num_matches": 50, "num_frames": 3}
    return MatchedImages(to=to, source=source, T_to_source=T.tolist(), covariance=covariance, **of_features)


@pytest.mark.parametrize("is_copied", [False, True])
def test_images_show_how_cameras_are_placed(
    rig_of_three: Path, truth: dict[str, Pose], tmp_path: Path, is_copied: bool
) -> None:
    """Wrong poses hardly matter; cameras that look elsewhere show nothing, and copies of a sweep are one sweep."""
    folder = rig_of_three.parent
    if is_copied:
        folder = tmp_path / "rig"
        shutil.copytree(rig_of_three.parent, folder)
        shutil.copytree(folder / "front" / "points", folder / "left" / "points")
        file = folder / "left" / DRIVE_FILE
        file.write_text(file.read_text().replace("../front/points", "points"))
    drives = {name: read_drive(folder / name) for name in AZIMUTHS_DEG}
    pairs = pair_images(drives, truth, SweepCache()).pairs
    (right,) = fit_all(pairs, truth)
    assert (right.source, right.to, right.num_frames) == ("front", "left", 4)
    error = right.differs_from(truth)
    assert error.rotation_deg < 0.15
    assert error.camera_center_m < 0.05
    rng = np.random.default_rng(2)
    wrong = {name: displace(T, 2.0, 0.1, rng) for name, T in truth.items()}
    (off,) = fit_all(pairs, wrong)
    assert off.differs_from(truth).rotation_deg < 0.5 < 2.0 < off.differs_from(wrong).rotation_deg


def test_a_camera_that_is_far_off_is_contradicted(drives: dict[str, Drive], truth: dict[str, Pose]) -> None:
    turned = apply_twist(truth["left"], np.radians([0.0, 0.0, 0.0, 0.0, 14.0, 0.0]))
    wrong = truth | {"left": turned}
    (shown,) = fit_all(pair_images(drives, truth, SweepCache()).pairs, wrong)
    assert shown.is_contradicted_by(wrong)
    assert not shown.is_contradicted_by(truth)


def stamped(drive: Drive, later_s: float, **changes: object) -> Drive:
    frames = [
        frame.model_copy(update={"image_stamp": 10.0 * at + later_s}) for at, frame in enumerate(drive.frames)
    ]
    return drive.model_copy(update={"frames": tuple(frames), **changes})


@pytest.mark.parametrize(
    ("later_s", "offset_s", "speed_m_s", "num_pairs"),
    [
        (0.0, 0.0, None, 1),
        (0.015, 0.0, None, 1),
        (0.015, 0.0, 0.0, 1),
        (0.05, 0.0, None, 0),
        (0.05, -0.05, None, 1),
        (0.05, 0.0, 0.0, 1),
        (0.05, 0.0, 3.0, 0),
    ],
)
def test_images_of_different_moments_are_not_compared(
    drives: dict[str, Drive],
    truth: dict[str, Pose],
    later_s: float,
    offset_s: float,
    speed_m_s: float | None,
    num_pairs: int,
) -> None:
    motion = {} if speed_m_s is None else {"motion": Motion(speed_m_s=speed_m_s)}
    drives = {
        "front": stamped(drives["front"], 0.0),
        "left": stamped(drives["left"], later_s, time_offset_s=offset_s, **motion),
    }
    poses = {name: truth[name] for name in drives}
    shown = fit_all(pair_images(drives, poses, SweepCache()).pairs, poses)
    assert len(shown) == num_pairs
    # A car moves by 15 cm in 15 ms; the matches themselves tell the place to a few centimetres.
    apart_m = 0.0 if speed_m_s == 0.0 else 10.0 * abs(later_s + offset_s)
    variances = [np.diag(tie.covariance) for tie in shown]
    assert all((max(each[:3]) >= 0.1**2) == (apart_m >= 0.1) for each in variances)
    assert all((min(each[3:]) >= np.radians(0.14) ** 2) == (apart_m >= 0.1) for each in variances)


def test_matches_on_one_object_tell_no_rotation() -> None:
    rng = np.random.default_rng(0)
    T = make_pose((0.1, -0.2, 0.05), (0.4, 0.0, 0.1))

    def fitted(width_m: float) -> RelativePose | None:
        points = rng.uniform([-width_m, -width_m, 10.0], [width_m, width_m, 14.0], (60, 3))
        moved = points @ T[:3, :3].T + T[:3, 3]
        rays = moved + 0.02 * rng.standard_normal((60, 3))
        return fit_relative_pose(T, points, rays / np.linalg.norm(rays, axis=1, keepdims=True))

    assert fitted(0.1) is None
    found = fitted(6.0)
    assert found is not None
    assert compare_poses(found.T, T).rotation_deg < 0.2


def test_cameras_are_placed_along_the_surest_ties() -> None:
    truth = {
        name: make_pose((0.1 * at, -0.2 * at, 0.3), (at, 0.2 * at, 0.1)) for at, name in enumerate("abcd")
    }

    def tie(to: str, source: str, sigma_deg: float, off: float = 0.0) -> MatchedImages:
        T = apply_twist(truth[to] @ inverse(truth[source]), np.radians([0.0, 0.0, 0.0, 0.0, off, 0.0]))
        return shown_of(to, source, T, sigma_deg)

    # The least sure tie is wrong, and closes a loop.
    ties = [tie("c", "a", 0.5, off=3.0), tie("b", "a", 0.1), tie("c", "b", 0.2), tie("d", "c", 0.1)]
    for anchor in truth:
        places = RigPlaces.by(anchor, truth[anchor], ties)
        assert all(compare_poses(places.poses[name], T).rotation_deg < 1e-6 for name, T in truth.items())
    assert [tie.is_contradicted_by(truth) for tie in ties] == [True, False, False, False]
    assert [sorted(group) for group in tied_groups(ties[:2])] == [["a", "b", "c"]]
    assert tied_groups([ties[1], ties[3]]) == [["a", "b"], ["c", "d"]]
    # A difference within three standard errors is none.
    assert not tie("b", "a", 0.7, off=2.0).is_contradicted_by(truth)
    assert tie("b", "a", 0.3, off=2.0).is_contradicted_by(truth)


def test_a_camera_that_images_contradict_is_calibrated_again(
    turned_results: tuple[Result, Path], truth: dict[str, Pose]
) -> None:
    result, out = turned_results
    assert result.exit_code in (0, 3), result.output
    for name, T in truth.items():
        calibration = read_calibration(out / f"{name}.yaml")
        assert compare_poses(calibration.pose, T).rotation_deg < 0.3, name
        assert any("calibrated again" in note for note in calibration.notes) == (name == "left")
    assert (
        read_calibration(out / "left.yaml").settings.options["given"] == "the place by its images and front"
    )
    (shown,) = read_document(out / "rig_calibration.yaml")["images"]
    assert shown["rotation_deg"] < 0.3
    assert "features in images of front and left show a transform" in " ".join(result.stderr.split())


def test_without_it_the_camera_ends_elsewhere(
    turned_results: tuple[Result, Path], truth: dict[str, Pose]
) -> None:
    """The start is too far: otherwise the test above proves nothing."""
    (note,) = (
        note for note in read_calibration(turned_results[1] / "left.yaml").notes if "calibrated again" in note
    )
    assert float(note.partition("it ended ")[2].split()[0]) > 2.0


def test_trusted_cameras_that_images_contradict_make_a_rig_doubtful(
    rig_of_three: Path, truth: dict[str, Pose], tmp_path: Path
) -> None:
    """By labels, all cameras are trusted; the file is then changed as if their images showed something else."""
    out = tmp_path / "results"
    assert run(rig_of_three, "-o", out).exit_code == 0
    file = out / "rig_calibration.yaml"
    document = read_document(file)
    turn = np.radians([0.0, 0.0, 0.0, 0.0, 2.0, 0.0])
    shown = document["images"][0]
    shown["T_to_source"] = apply_twist(np.array(shown["T_to_source"]), turn).tolist()
    file.write_text(yaml.safe_dump(document))
    page = tmp_path / "rig.html"
    assert invoke("report", rig_of_three, file, "-o", page).exit_code == 0
    text = page.read_text()
    assert "The cameras contradict their images" in text
    assert "from that of their calibrations, more than a degree" in text
    drives = read_rig(rig_of_three).read_drives()
    rig, _ = read_rig_result(read_rig(rig_of_three), drives, file)
    assert rig.status == "not_trusted"
    assert {pair.a + pair.b: pair.is_doubted for pair in rig.pairs} == {
        "frontleft": True,
        "frontrear": True,
        "leftrear": True,
    }
    # A camera that is not trusted makes no pair of others doubtful.
    left = out / "left.yaml"
    changed = read_document(left) | {"status": "not_trusted", "reasons": ["it is a test"], "topics": ["test"]}
    left.write_text(yaml.safe_dump(changed))
    rig, _ = read_rig_result(read_rig(rig_of_three), drives, file)
    assert [pair.is_doubted for pair in rig.pairs if {pair.a, pair.b} == {"front", "rear"}] == [False]
    shown["to"] = "nobody"
    file.write_text(yaml.safe_dump(document))
    refused = invoke("report", rig_of_three, file, "-o", page)
    assert refused.exit_code == 1
    assert "images[0]: found front, nobody, expected two cameras" in str(refused.exception)


def test_the_pose_before_speaks_against_one_that_is_no_better(
    turned_results: tuple[Result, Path], rig_of_three: Path, drives: dict[str, Drive]
) -> None:
    results = {name: read_calibration(turned_results[1] / f"{name}.yaml") for name in OVERLAPPING}
    left = results["left"].model_copy(update={"status": "trusted", "reasons": (), "topics": ()})
    data = RigData(read_rig(rig_of_three), drives, CalibrationConfig(cues=("edges",)), SweepCache())

    def judged(before_deg: float) -> tuple[str, tuple[str, ...]]:
        T = apply_twist(left.pose, np.radians([0.0, 0.0, 0.0, 0.0, before_deg, 0.0]))
        before = left.model_copy(update={"rows_camera_lidar": T.tolist()})
        again = RigImages(data, results | {"left": before}).judged("left", left)
        return again.status, again.topics

    assert judged(5.0) == ("trusted", ())
    assert judged(0.001) == ("not_trusted", ("other-pose",))


def test_only_cameras_that_are_not_trusted_are_moved_to_their_images(
    turned_results: tuple[Result, Path], rig_of_three: Path, drives: dict[str, Drive], truth: dict[str, Pose]
) -> None:
    """The images are sure, and the pose of one camera is wrong by less than a degree."""
    results = {name: read_calibration(turned_results[1] / f"{name}.yaml") for name in OVERLAPPING}
    wide = Uncertainty.from_covariance(
        truth["left"], np.diag([0.1**2] * 3 + [np.radians(0.5) ** 2] * 3), np.full(6, 1e4)
    )
    off = apply_twist(truth["left"], np.radians([0.0, 0.0, 0.0, 0.0, 0.6, 0.0]))
    data = RigData(read_rig(rig_of_three), drives, CalibrationConfig(cues=("edges",)), SweepCache())

    def settled(status: str) -> dict[str, CalibrationDocument]:
        left = {"status": status, "rows_camera_lidar": off.tolist(), "uncertainty": wide}
        cameras = {
            "front": results["front"].model_copy(update={"status": "trusted"}),
            "left": results["left"].model_copy(update=left),
        }
        images, before = RigImages(data, cameras), dict(cameras)
        shown = images.settle(cameras)
        assert [(tie.source, tie.to) for tie in shown] == [("front", "left")]
        assert cameras["front"] is before["front"]
        return cameras

    moved = settled("not_trusted")["left"]
    assert moved.status == "not_trusted"
    assert moved.notes[-1].startswith("overlapping images of the rig moved the camera by")
    assert compare_poses(moved.pose, truth["left"]).rotation_deg < 0.3
    assert np.array_equal(settled("trusted")["left"].pose, off)


def test_a_camera_that_cannot_be_calibrated_again_keeps_what_it_had(
    turned_results: tuple[Result, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise CalibrationError("too few points are seen")

    monkeypatch.setattr(RigImages, "load_near", fail)
    result = run(turned_results[1].parent / "rig", "--cue", "edges", "-o", tmp_path / "out")
    assert result.exit_code == 3, result.output
    notes = read_calibration(tmp_path / "out" / "left.yaml").notes
    assert any(
        "could not be calibrated again from the place by its images and front: too few" in note
        for note in notes
    )


def test_what_cannot_be_matched_is_named(
    rig_of_three: Path, drives: dict[str, Drive], tmp_path: Path
) -> None:
    data = RigData(read_rig(rig_of_three), drives, CalibrationConfig(cues=("features",)), SweepCache())
    with pytest.raises(InputError, match="match_images: found feature vectors as the cue of front"):
        RigImages.check(data)
    file = tmp_path / "rig.yaml"
    file.write_text("{semcal_rig: 1, cameras: {a: a, b: b}, match_images: maybe}")
    with pytest.raises(InputError, match="match_images: found 'maybe', expected true or false"):
        read_rig(file)


def test_an_image_that_cannot_be_read_stops_nothing(rig_of_three: Path, tmp_path: Path) -> None:
    """By labels, images are only matched."""
    shutil.copytree(rig_of_three.parent, tmp_path / "rig")
    image = min((tmp_path / "rig" / "left" / "images").iterdir())
    image.write_bytes(b"")
    result = run(tmp_path / "rig", "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "images of front and left were not matched" in " ".join(result.stderr.split())
    rig = read_rig(tmp_path / "rig" / "rig.yaml")
    read, _ = read_rig_result(rig, rig.read_drives(), tmp_path / "out" / "rig_calibration.yaml")
    assert any("images of front and left were not matched" in note for note in read.notes)


def test_where_nothing_overlaps_it_is_said(rig_of_three: Path, tmp_path: Path) -> None:
    shutil.copytree(rig_of_three.parent, tmp_path / "rig")
    file = tmp_path / "rig" / "rig.yaml"
    file.write_text("{semcal_rig: 1, match_images: true, cameras: {front: front, rear: rear}}")
    result = run(file, "-o", tmp_path / "out")
    assert result.exit_code == 0
    assert "no two cameras whose images show enough" in " ".join(result.stderr.split())
    assert read_document(tmp_path / "out" / "rig_calibration.yaml")["images"] == []
