import json
from pathlib import Path

import numpy as np
import pytest
from commands import invoke

from semcal_cli.assessment.inspection import inspect
from semcal_cli.assessment.pairing import find_identical_files
from semcal_cli.drive.document import DRIVE_FILE, read_drive
from semcal_cli.files.documents import document_text, read_document
from semcal_cli.files.images import write_image
from semcal_cli.files.writing import write_text


def changed(street: Path, folder: Path, **changes: object) -> Path:
    """The street's drive with some keys changed, its files where they are."""
    document = read_document(street / DRIVE_FILE) | changes
    for frame in document["frames"]:
        for key in ("points", "point_labels", "image_labels", "image"):
            frame[key] = str(street / frame[key])
    write_text(document_text(document, "yaml"), folder / DRIVE_FILE)
    return folder


def test_a_good_drive_has_nothing_suspicious(street: Path) -> None:
    report = inspect(read_drive(street))
    assert not report.suspicions
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


def test_what_is_suspicious_comes_first_and_equal_faults_are_one_line(street: Path, tmp_path: Path) -> None:
    """Frames of which two have stamps far apart, and one a label image that is none; no row for each frame."""
    drive = changed(street, tmp_path)
    document = read_document(tmp_path / DRIVE_FILE)
    for frame in document["frames"][:2]:
        frame |= {"points_stamp": 1.0, "image_stamp": 1.5}
    document["frames"][3]["image_labels"] = str(street / "drive.yaml")
    write_text(document_text(document, "yaml"), tmp_path / DRIVE_FILE)
    lines = invoke("inspect", drive).stdout.splitlines()
    names = [frame["points"] for frame in document["frames"]]
    assert lines[0] == f"suspicious  {names[0]}, {names[1]}: sweep and picture are 0.500 s apart"
    assert lines[1].startswith(f"suspicious  {names[3]}: {street / 'drive.yaml'}: ")
    assert not any(line.startswith("points") for line in lines)
    assert "is not checked here" in "\n".join(lines)
    report = json.loads(invoke("inspect", drive, "--json").output)
    assert [frame["gap_s"] for frame in report["frames"]] == [0.5, 0.5, None, None]
    rows = invoke("inspect", drive, "--frames").stdout.splitlines()
    assert rows[: len(lines) - 1] == lines[:-1]
    assert len(rows) == len(lines) - 1 + 1 + len(names)


def test_too_few_frames_are_said_to_be_few(street: Path, tmp_path: Path) -> None:
    assert inspect(read_drive(street)).advice == ()
    frames = read_document(street / DRIVE_FILE)["frames"]
    report = inspect(read_drive(changed(street, tmp_path, frames=frames[:2])))
    assert report.advice == ("2 frames are few: 4 or more decide the mounting, 20 the accuracy",)
    camera = read_document(street / DRIVE_FILE)["camera"]
    narrow = camera | {"K": [[1000.0, 0.0, 319.5], [0.0, 1000.0, 179.5], [0.0, 0.0, 1.0]]}
    report = inspect(read_drive(changed(street, tmp_path, frames=frames, camera=narrow)))
    assert report.advice == ("4 frames through a lens of 35 degrees across are few: 20 or more help",)


def test_a_mirrored_cloud_is_recognised(street: Path, tmp_path: Path) -> None:
    frames = read_document(street / DRIVE_FILE)["frames"]
    for index, frame in enumerate(frames):
        points = np.fromfile(street / frame["points"], np.float32).reshape(-1, 4)
        (points * np.array([1, -1, 1, 1], np.float32)).tofile(tmp_path / f"{index}.bin")
    changed(street, tmp_path, frames=frames)
    document = read_document(tmp_path / DRIVE_FILE)
    for index, frame in enumerate(document["frames"]):
        frame["points"] = f"{index}.bin"
    write_text(document_text(document, "yaml"), tmp_path / DRIVE_FILE)
    (suspicion,) = inspect(read_drive(tmp_path)).suspicions
    assert suspicion.startswith("the clouds seem mirrored: with y negated, labels share ")


@pytest.mark.parametrize("scale", [2 / 3, 2.0])
def test_intrinsics_of_another_picture_size_are_suspicious(
    street: Path, tmp_path: Path, scale: float
) -> None:
    document = read_document(street / DRIVE_FILE)
    camera = document["camera"]
    off_center = np.array([[1.0, 1.0, 1.02], [1.0, 1.0, 0.98], [1.0, 1.0, 1.0]])
    K = np.array(camera["K"]) * off_center
    frames = document["frames"][:1]
    right = changed(street, tmp_path, frames=frames, camera=camera | {"K": K.tolist()})
    assert not any("K may belong" in line for line in inspect(read_drive(right)).suspicions)
    K[:2] *= scale
    frames = read_document(street / DRIVE_FILE)["frames"][:1]
    wrong = changed(street, tmp_path, frames=frames, camera=camera | {"K": K.tolist()})
    assert any("K may belong" in line for line in inspect(read_drive(wrong)).suspicions)


def test_a_drive_without_labels_is_looked_at(street: Path, tmp_path: Path) -> None:
    document = read_document(street / DRIVE_FILE)
    frames = [{"points": str(street / frame["points"])} for frame in document["frames"]]
    write_text(document_text(document | {"frames": frames}, "yaml"), tmp_path / DRIVE_FILE)
    report = inspect(read_drive(tmp_path))
    assert report.pattern.startswith("64 channels")
    assert report.suspicions == (
        "no labels of pixels: `semcal label` makes them with a network; without them a calibration needs a start "
        "(`--init`)",
    )
    found = invoke("inspect", tmp_path)
    assert found.exit_code == 0, found.output
    assert "of points   no labels; segments and edges need none" in found.output


def test_frames_of_one_scene_are_said_to_count_as_one(street: Path, tmp_path: Path) -> None:
    document = read_document(changed(street, tmp_path) / DRIVE_FILE)
    document["frames"] = [*document["frames"], document["frames"][0] | {"image": None}]
    write_text(document_text(document, "yaml"), tmp_path / DRIVE_FILE)
    (advice,) = inspect(read_drive(tmp_path)).advice
    assert advice.startswith(
        "the 5 frames show 4 scenes, and frames of one scene count as one: record while driving"
    )


def test_sides_that_say_nothing_are_suspicious(street: Path, tmp_path: Path) -> None:
    document = read_document(street / DRIVE_FILE)
    drive = changed(street, tmp_path, frames=document["frames"][:1])
    document = read_document(tmp_path / DRIVE_FILE)
    height, width = document["camera"]["height"], document["camera"]["width"]
    ids = np.arange(height * width).reshape(height, width)
    pictures = {
        "one.npy": np.zeros((height, width), np.uint8),
        "many.npy": (ids % 300).astype(np.uint16),
        "few.npy": np.where(ids < 9, ids % 3, 255).astype(np.uint8),
    }
    found = {}
    for name, picture in pictures.items():
        np.save(tmp_path / name, picture)
        document["frames"][0]["image_labels"] = name
        document["classes"], document["ignore"] = {}, {"image": [255] if name == "few.npy" else []}
        write_text(document_text(document, "yaml"), tmp_path / DRIVE_FILE)
        report = inspect(read_drive(drive))
        found[name] = [*report.suspicions, *report.frames[0].suspicions]
    write_image(np.dstack([pictures["one.npy"]] * 3), tmp_path / "colors.png")
    document["frames"][0]["image_labels"] = "colors.png"
    write_text(document_text(document, "yaml"), tmp_path / DRIVE_FILE)
    (complaint,) = inspect(read_drive(drive)).frames[0].suspicions
    assert found["one.npy"] == ["pixels of 0 only, over all frames", "pixels of 0 only"]
    assert found["many.npy"] == ["300 classes of pixels: instance ids or colours, perhaps"]
    assert found["few.npy"] == ["100% of the pixels carry no information"]
    assert "colors.png: " in complaint


def test_frames_that_cannot_be_read_are_named_and_the_others_are_looked_at(
    street: Path, tmp_path: Path
) -> None:
    document = read_document(street / DRIVE_FILE)
    frames = document["frames"]
    drive = changed(street, tmp_path, frames=frames)
    (tmp_path / "cut.bin").write_bytes(b"123")
    (tmp_path / "grey.png").write_bytes(b"no picture")
    frames[2]["points"], frames[3]["image"] = "cut.bin", "grey.png"
    write_text(document_text(document | {"frames": frames}, "yaml"), tmp_path / DRIVE_FILE)
    report = inspect(read_drive(drive))
    assert [bool(frame.suspicions) for frame in report.frames] == [False, False, True, False]
    (complaint,) = report.frames[2].suspicions
    assert complaint.startswith(f"{tmp_path}/cut.bin: 3 bytes")
    assert report.frames[3].num_points > 0
    assert any("grey.png: found 10 bytes of no known format" in line for line in report.suspicions)


def test_pictures_of_another_size_than_the_labels_are_suspicious(street: Path, tmp_path: Path) -> None:
    document = read_document(street / DRIVE_FILE)
    drive = changed(street, tmp_path, frames=document["frames"][:1])
    document = read_document(tmp_path / DRIVE_FILE)
    document["frames"][0]["image"] = "half.png"
    write_text(document_text(document, "yaml"), tmp_path / DRIVE_FILE)
    write_image(np.zeros((180, 320), np.uint8), tmp_path / "half.png")
    suspicions = inspect(read_drive(drive)).suspicions
    assert "half.png is 320 x 180, the camera's pictures are 640 x 360" in suspicions


def test_identical_files_are_named(drive: Path) -> None:
    document = read_document(drive / DRIVE_FILE)
    first, second, *others = document["frames"]
    for kind in ("points", "point_labels", "image_labels", "image"):
        (drive / second[kind]).write_bytes((drive / first[kind]).read_bytes())
    (drive / others[1]["image"]).write_bytes((drive / others[0]["image"]).read_bytes())
    assert find_identical_files(read_drive(drive)) == [
        "frame 000001 has the same points, labels of points, label images and pictures as frame 000000",
        "frame 000003 has the same pictures as frame 000002",
    ]
    write_text(document_text(document | {"frames": [first] * 70}, "yaml"), drive / DRIVE_FILE)
    same = "the same points, labels of points, label images and pictures"
    sentence = f"frame points/000000.bin is listed 70 times, with {same}"
    assert find_identical_files(read_drive(drive)) == [sentence]
    assert sentence in inspect(read_drive(drive)).suspicions


def test_what_files_hold_reaches_the_terminal_as_letters(street: Path, tmp_path: Path) -> None:
    """Not as the sequences by which a name could write over other lines."""
    drive = changed(street, tmp_path)
    document = read_document(tmp_path / DRIVE_FILE)
    points = document["classes"]["points"]
    points["road\x1b[2J\nverdict"] = points.pop("road")
    write_text(document_text(document, "yaml"), tmp_path / DRIVE_FILE)
    said = invoke("inspect", drive, "--frames").stdout
    assert "road\\x1b[2J\\nverdict" in said
    assert "\x1b" not in said
