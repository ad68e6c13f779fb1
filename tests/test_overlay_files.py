"""What `semcal overlay` and `semcal export ply` write: images, videos and points, and what they never replace."""

import shutil
import weakref
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import plyfile
import pytest
from commands import invoke

from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError
from semcal_cli.formats import write_transform
from semcal_cli.report.named_frames import named_paths
from semcal_cli.report.overlay_video import write_video
from semcal_cli.report.points import points_in_image


@pytest.mark.parametrize("by", ["class", "depth", "agreement", "segment", "edge"])
def test_overlay_of_a_drive(street: Path, street_truth: np.ndarray, tmp_path: Path, by: str) -> None:
    off = street_truth.copy()
    off[0, 3] += 0.3
    write_transform(off, tmp_path / "off.yaml", "semcal")
    options = ["--against", tmp_path / "off.yaml", "--by", by, "--max-frames", "2"]
    result = invoke("overlay", street, street, *options, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    first, second = sorted((tmp_path / "out").iterdir())
    assert (first.name, second.name) == ("000000.png", "000003.png")  # named after the frames
    image = cv2.imread(str(first))
    assert image.shape[1] == 2 * 640
    assert image.shape[0] > 360


def test_images_are_named_after_their_frames(tmp_path: Path) -> None:
    """Also where names are no names of files, or repeat."""
    names = ["000025", "a/1.pcd", "a_1.pcd", "..", "000025"]
    assert [path.name for path in named_paths(tmp_path, names)] == [
        *("000025.png", "a_1.pcd.png", "a_1.pcd-000002.png", "frame.png", "000025-000004.png")
    ]


@pytest.mark.parametrize("command", ["overlay", "calibrate"])
def test_images_replace_nothing_that_is_read(command: str, street: Path, tmp_path: Path) -> None:
    drive = tmp_path / "drive"
    shutil.copytree(street, drive)
    labels = drive / "image_labels"
    before = (labels / "000000.png").read_bytes()
    options = {"overlay": [drive, "-o", labels], "calibrate": ["--overlay", labels]}
    result = invoke(command, drive, *options[command])
    assert isinstance(result.exception, InputError)
    assert "000000.png: found a file that this run reads; choose another folder" in str(result.exception)
    assert (labels / "000000.png").read_bytes() == before


def test_labels_and_a_video_are_drawn(street: Path, tmp_path: Path) -> None:
    for name, options in (("bare", []), ("labels", ["--labels"])):
        arguments = ["--by", "depth", "--max-frames", 2, "-o", tmp_path / name, *options]
        result = invoke("overlay", street, street, *arguments, "--video", tmp_path / f"{name}.mp4")
        assert result.exit_code == 0, result.output
    bare, labelled = (
        cv2.imread(str(tmp_path / name / "000000.png")).astype(int) for name in ("bare", "labels")
    )
    assert np.abs(bare - labelled).mean() > 10.0
    video = cv2.VideoCapture(str(tmp_path / "labels.mp4"))
    frames = [frame for has_frame, frame in iter(video.read, (False, None)) if has_frame]
    assert len(frames) == 2
    first, last = (frame[: len(labelled), : labelled.shape[1]].astype(int) for frame in frames)
    lossy = np.abs(first - labelled).mean()
    assert lossy < 0.5 * min(np.abs(first - bare).mean(), np.abs(last - labelled).mean())
    kept = invoke("overlay", street, street, "--video", tmp_path / "bare.mp4")
    assert str(kept.exception) == f"{tmp_path}/bare.mp4: found a file; choose another name, or add --force"
    again = invoke("overlay", street, street, "--max-frames", 1, "--video", tmp_path / "bare.mp4", "--force")
    assert again.exit_code == 0
    wrong = invoke("overlay", street, street, "-o", tmp_path / "none", "--video", tmp_path / "a.avi")
    assert str(wrong.exception) == f"{tmp_path}/a.avi: found suffix '.avi', expected .mp4"
    assert not (tmp_path / "none").exists()
    assert invoke("overlay", street, street).exit_code == 2


def test_one_image_of_a_video_is_in_memory_at_a_time(tmp_path: Path) -> None:
    """They differ in size, and the video has the largest sides, made even."""
    images, most = list[weakref.ref[np.ndarray]](), 0

    def drawn() -> Iterator[np.ndarray]:
        nonlocal most
        for height in (31, 33, 30, 20):
            image = np.full((height, 41, 3), 200, np.uint8)
            images.append(weakref.ref(image))
            most = max(most, sum(kept() is not None for kept in images))
            yield image
            del image

    write_video(drawn(), tmp_path / "v.mp4")
    assert most <= 2
    video = cv2.VideoCapture(str(tmp_path / "v.mp4"))
    frames = [frame for has_frame, frame in iter(video.read, (False, None)) if has_frame]
    assert [frame.shape for frame in frames] == [(34, 42, 3)] * 4


def test_points_are_exported_with_the_colours_of_the_image(
    street: Path, street_truth: np.ndarray, tmp_path: Path
) -> None:
    result = invoke("export", "ply", street, street, "-o", tmp_path, "--max-frames", 2)
    assert result.exit_code == 0, result.output
    assert [path.name for path in sorted(tmp_path.iterdir())] == ["000000.ply", "000003.ply"]
    (vertices,) = plyfile.PlyData.read(tmp_path / "000000.ply").elements
    points = np.column_stack([vertices[axis] for axis in "xyz"])
    drive = read_drive(street)
    projected = points_in_image(points.astype(np.float32), street_truth, drive.camera)
    assert len(projected.indices) == len(points) > 1000
    image = cv2.imread(str(street / "images/000000.png"))
    colors = np.column_stack([vertices[name] for name in ("blue", "green", "red")])[projected.indices]
    u, v = projected.pixels.T
    inside = (u >= 0) & (v >= 0) & (u < image.shape[1]) & (v < image.shape[0])
    np.testing.assert_array_equal(colors[inside], image[v[inside], u[inside]])
