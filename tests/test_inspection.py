import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from commands import invoke, unwrapped
from conftest import edited

from semcal_cli.checks.identical_files import find_identical_files
from semcal_cli.checks.inspection import DriveReport, inspect
from semcal_cli.checks.motion_report import NO_MOTION
from semcal_cli.cli.inspect import LABEL_WIDTH
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.document import DRIVE_FILE, read_drive
from semcal_cli.files.documents import read_document
from semcal_cli.files.image_files import write_image
from semcal_cli.synthetic.street_motion import vehicle_motion
from semcal_cli.synthetic.synthesis import synthesize


def looked_at(drive: Path) -> DriveReport:
    return inspect(read_drive(drive))


def test_a_good_drive_has_nothing_suspicious(street: Path) -> None:
    report = looked_at(street)
    assert not report.suspicions
    assert not report.advice
    assert not any(frame.suspicions for frame in report.frames)
    assert report.pattern.startswith("64 channels")
    assert report.field_of_view_deg == pytest.approx((90.0, 58.7), abs=0.2)
    low, high = report.elevations_deg
    assert -31.0 < low < high < 11.0
    assert report.azimuths_deg > 350.0
    assert "road" in report.shared_classes
    for frame in report.frames:
        assert sum(frame.point_classes.values()) + frame.num_points_ignored == frame.num_points
        assert sum(frame.image_classes.values()) + frame.num_pixels_ignored == 640 * 360


def test_what_is_suspicious_comes_first_and_equal_faults_are_one_line(drive: Path) -> None:
    """Frames of which two have stamps far apart, and one a label image that is none; no row for each frame."""
    with edited(drive) as document:
        for frame in document["frames"][:2]:
            frame |= {"points_stamp": 1.0, "image_stamp": 1.5}
        document["frames"][3]["image_labels"] = DRIVE_FILE
    lines = unwrapped(invoke("inspect", drive).stdout, LABEL_WIDTH).splitlines()
    names = [Path(frame["points"]).stem for frame in document["frames"]]
    assert lines[0] == f"warning     {names[0]}, {names[1]}: sweep and image are 0.500 s apart"
    assert lines[1].startswith(f"warning     {names[3]}: {drive / DRIVE_FILE}: ")
    assert not any(line.startswith("frame ") for line in lines)
    assert "inspect does not check intrinsics" in "\n".join(lines)
    report = json.loads(invoke("inspect", drive, "--json").output)
    assert [frame["gap_s"] for frame in report["frames"]] == [0.5, 0.5, None, None]
    whole = invoke("inspect", drive, "--frames", env={"COLUMNS": "240"})
    rows = unwrapped(whole.stdout, LABEL_WIDTH).splitlines()
    assert rows[: len(lines) - 1] == lines[:-1]
    assert len(rows) == len(lines) + 1 + len(names)
    assert rows[-1] == lines[-1]


def test_what_is_too_little_is_said(drive: Path) -> None:
    with edited(drive) as document:
        all_frames, camera = document["frames"], document["camera"]
        document["frames"] = all_frames[:2]
    few = "2 frames: use at least 4 to find the mounting, and 20 for accuracy"
    assert looked_at(drive).advice == (few,)
    with edited(drive) as document:
        K = [[1000.0, 0.0, 319.5], [0.0, 1000.0, 179.5], [0.0, 0.0, 1.0]]
        document |= {"camera": camera | {"K": K}, "frames": [*all_frames, all_frames[0] | {"image": None}]}
    same, narrow = looked_at(drive).advice
    assert same.startswith(
        "the 5 frames show 4 scenes, and frames of one scene count as one: record while driving"
    )
    assert narrow == "4 scenes through a lens of 35 degrees across: use at least 20"


def test_a_mirrored_cloud_is_recognised(drive: Path) -> None:
    for path in (drive / "points").iterdir():
        points = np.fromfile(path, np.float32).reshape(-1, 4)
        (points * np.array([1, -1, 1, 1], np.float32)).tofile(path)
    (suspicion,) = looked_at(drive).suspicions
    assert suspicion.startswith("the clouds seem mirrored: with y negated, labels share ")


@pytest.mark.parametrize(("scale", "is_suspicious"), [(1.0, False), (2 / 3, True), (2.0, True)])
def test_intrinsics_of_another_image_size_are_suspicious(
    drive: Path, scale: float, is_suspicious: bool
) -> None:
    with edited(drive) as document:
        document["frames"] = document["frames"][:1]
        off_center = np.array([[1.0, 1.0, 1.02], [1.0, 1.0, 0.98], [1.0, 1.0, 1.0]])
        K = np.array(document["camera"]["K"]) * off_center
        K[:2] *= scale
        document["camera"]["K"] = K.tolist()
    assert any("K may belong" in line for line in looked_at(drive).suspicions) == is_suspicious


def test_a_drive_without_labels_is_looked_at(drive: Path) -> None:
    with edited(drive) as document:
        document["frames"] = [{"points": frame["points"]} for frame in document["frames"]]
    found = invoke("inspect", drive)
    assert found.exit_code == 0, found.output
    output = unwrapped(found.output, LABEL_WIDTH)
    suspicious, *others = output.splitlines()
    assert suspicious == (
        "warning     no image labels: `semcal label` makes them with a network; without them a calibration needs a "
        "start (`--init`)"
    )
    assert not any(line.startswith(("warning", "points", "pixels", "both")) for line in others)
    assert "64 channels" in output
    assert not output.splitlines()[-1].startswith("next")


def test_what_to_type_next_gives_a_start(drive: Path) -> None:
    with edited(drive) as document:
        del document["T_camera_lidar"]
        for frame in document["frames"]:
            del frame["image_labels"]
    *_, last = invoke("inspect", drive).output.splitlines()
    assert last == f"next        semcal calibrate {drive} -o calibration.yaml --init-rpy-xyz R P Y X Y Z"


def test_a_rig_is_calibrated_into_a_folder(rig: Path) -> None:
    *_, last = invoke("inspect", rig).output.splitlines()
    assert last == f"next        semcal calibrate {rig} -o results"


WIDE, HIGH = 640, 360
IDS = np.arange(WIDE * HIGH).reshape(HIGH, WIDE)


@pytest.mark.parametrize(
    ("image", "ignored", "expected"),
    [
        (
            np.zeros((HIGH, WIDE), np.uint8),
            [],
            ["pixels have only the class 0 in all frames", "pixels have only the class 0"],
        ),
        (
            (IDS % 300).astype(np.uint16),
            [],
            ["300 classes of pixels: perhaps they are instance ids or colours"],
        ),
        (
            np.where(IDS < 9, IDS % 3, 255).astype(np.uint8),
            [255],
            ["100% of the pixels carry no information"],
        ),
    ],
)
def test_label_images_that_say_nothing_are_suspicious(
    drive: Path, image: np.ndarray, ignored: list[int], expected: list[str]
) -> None:
    np.save(drive / "labels.npy", image)
    with edited(drive) as document:
        document["frames"] = [document["frames"][0] | {"image_labels": "labels.npy"}]
        document |= {"classes": {}, "ignore": {"image": ignored}}
    report = looked_at(drive)
    assert [*report.suspicions, *report.frames[0].suspicions] == expected


def test_files_that_cannot_be_read_are_named_and_the_others_are_looked_at(drive: Path) -> None:
    (drive / "cut.bin").write_bytes(b"123")
    (drive / "grey.png").write_bytes(b"no image")
    write_image(np.zeros((180, 320), np.uint8), drive / "half.png")
    write_image(np.zeros((HIGH, WIDE, 3), np.uint8), drive / "colors.png")
    with edited(drive) as document:
        frames = document["frames"]
        frames[0]["image"], frames[1]["image_labels"] = "half.png", "colors.png"
        frames[2]["points"], frames[3]["image"] = "cut.bin", "grey.png"
    report = looked_at(drive)
    assert [len(frame.suspicions) for frame in report.frames] == [0, 1, 1, 0]
    assert "colors.png: " in report.frames[1].suspicions[0]
    assert report.frames[2].suspicions[0].startswith(f"{drive}/cut.bin: 3 bytes")
    assert report.frames[3].num_points > 0
    assert "half.png is 320 x 180, the camera's images are 640 x 360" in report.suspicions
    assert any("grey.png: found 8 bytes of an unknown format" in line for line in report.suspicions)


def test_the_size_of_every_image_is_looked_at(drive: Path) -> None:
    write_image(np.zeros((HIGH, WIDE - 20), np.uint8), drive / "narrow.png")
    write_image(np.zeros((HIGH, WIDE - 20), np.uint8), drive / "other.png")
    with edited(drive) as document:
        first = document["frames"][0]
        document["frames"] = [first, *document["frames"], *[first | {"image": f"{n}.png"} for n in range(6)]]
        document["frames"][2]["image"], document["frames"][3]["image"] = "narrow.png", "other.png"
    suspicions = looked_at(drive).suspicions
    assert "narrow.png and 1 more are 620 x 360, the camera's images are 640 x 360" in suspicions
    assert sum("no such file" in line for line in suspicions) == 4
    assert "2 more images cannot be read" in suspicions


def test_identical_files_are_named(drive: Path) -> None:
    first, second, *others = read_document(drive / DRIVE_FILE)["frames"]
    for kind in ("points", "point_labels", "image_labels", "image"):
        (drive / second[kind]).write_bytes((drive / first[kind]).read_bytes())
    (drive / others[1]["image"]).write_bytes((drive / others[0]["image"]).read_bytes())
    assert [finding.sentence for finding in find_identical_files(read_drive(drive))] == [
        "frame 000001 has the same points, point labels, label images and images as frame 000000",
        "frame 000003 has the same images as frame 000002",
    ]
    with edited(drive) as document:
        document["frames"] = [first] * 70
    same = "the same points, point labels, label images and images"
    sentence = f"frame points/000000.bin is listed 70 times, with {same}"
    assert [finding.sentence for finding in find_identical_files(read_drive(drive))] == [sentence]
    assert sentence in looked_at(drive).suspicions


def test_what_files_hold_reaches_the_terminal_as_letters(drive: Path) -> None:
    """Not as the sequences by which a name could write over other lines."""
    with edited(drive) as document:
        points = document["classes"]["points"]
        points["road\x1b[2J\nverdict"] = points.pop("road")
    said = invoke("inspect", drive, "--frames").stdout
    assert "road\\x1b[2J\\nverdict" in said
    assert "\x1b" not in said


def test_the_motion_is_told(tmp_path: Path) -> None:
    """How fast the rig is at the images, that poses do not reach all of them, and that one speed tells no clock."""
    config = SynthConfig(num_frames=3, seed=3, width=160, height=90, motion="mixed")
    drive = tmp_path / "mixed"
    synthesize(config, drive)
    report = looked_at(drive)
    motions = [vehicle_motion(config, number) for number in range(config.num_frames)]
    speeds = [each.speed_m_s for each in motions if each is not None]
    assert report.speeds_m_s == pytest.approx((min(speeds), max(speeds)), abs=1e-6)
    assert report.span_s == pytest.approx(2.0)
    assert "frames have the same motion" not in " ".join(report.advice)
    line = next(line for line in invoke("inspect", drive).stdout.splitlines() if line.startswith("motion"))
    assert line.startswith(
        f"motion      frames span 2.0 s, at {min(speeds):.1f} to {max(speeds):.1f} m/s, with turns up to "
    )
    lines = (drive / "poses.txt").read_text().splitlines(keepends=True)
    (drive / "poses.txt").write_text("".join(lines[:-1]))
    last = yaml.safe_load((drive / DRIVE_FILE).read_text())["frames"][-1]["points"]
    assert f"the poses do not cover the images of 1 frame {last}" in looked_at(drive).suspicions
    with edited(drive) as document:
        document["motion"] = {"twist": {"linear_m_s": [9.0, 0.0, 0.0], "angular_rad_s": [0.0, 0.0, 0.05]}}
    assert "at 9.0 to 9.0 m/s with turns of up to 2.9 degrees per second" in looked_at(drive).advice[-1]
    with edited(drive) as document:
        del document["motion"]
    assert looked_at(drive).advice[-1].endswith(f": {NO_MOTION.advice}")
