"""`semcal import bag --all-cameras`: a drive of each camera of a recording, of the same sweeps, and a rig."""

import os
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bag_imports import COLORS, Maker, image, info, small
from conftest import Cli

from semcal_cli.drive.document import read_drive
from semcal_cli.importing.bags.all_cameras import camera_names
from semcal_cli.importing.bags.messages import Topic
from semcal_cli.many.rig.rig_document import find_rig

NONE = {"info": lambda *about: None, "image": lambda *about: None}


def cameras(**images: Maker) -> dict[str, Maker]:
    """Give each camera its intrinsics and its images, by topic."""
    return {
        topic: maker
        for name, images_of in images.items()
        for topic, maker in ((f"{name}/camera_info", info()), (f"{name}/image_raw", images_of))
    }


def every_second() -> Maker:
    """Make images of a camera that is half as fast."""
    return lambda bag, index, stamp: (
        bag.image(np.roll(COLORS, -index, 1), "bgr8", stamp) if index % 2 == 0 else None
    )


def test_all_cameras_become_a_rig_with_the_same_sweeps(tmp_path: Path, cli: Cli) -> None:
    topics = cameras(left=image(), right=every_second())
    path = small(tmp_path, "mcap library", 12, **NONE, **topics)
    out = tmp_path / "rig drives"
    code, _, err = cli("import", "bag", path, "--all-cameras", "--max-frames", "6", "-o", out)
    assert code == 0, err
    rig = find_rig(out)
    assert rig is not None
    assert list(rig.cameras) == ["left", "right"]
    left, right = (read_drive(out / f"{name}.yaml") for name in rig.cameras)
    # The left camera has chosen six sweeps; of these, the right one has those with an image.
    assert len(left.frames) == 6
    of_left = {frame.points for frame in left.frames}
    assert {frame.points for frame in right.frames} <= of_left
    assert err.splitlines()[-2:] == [
        f"wrote {out / 'rig.yaml'}: 2 cameras, left, right",
        f"next: {shlex.join(['semcal', 'calibrate', str(out / 'rig.yaml'), '-o', str(out / 'results')])}",
    ]
    assert rig.read_drives().keys() == {"left", "right"}
    # Again, the same files replace themselves.
    before = {file: file.read_bytes() for file in out.rglob("*") if file.is_file()}
    assert cli("import", "bag", path, "--all-cameras", "--max-frames", "6", "-o", out)[0] == 0
    assert {file: file.read_bytes() for file in out.rglob("*") if file.is_file()} == before


def test_a_rig_that_is_there_is_kept_and_a_camera_that_fails_is_named(tmp_path: Path, cli: Cli) -> None:
    topics = cameras(a=image(), b=image())
    path, out = small(tmp_path / "good", "mcap library", **NONE, **topics), tmp_path / "out"
    out.mkdir()
    (out / "rig.yaml").write_text("cameras: {mine: mine}\n")
    words = ["import", "bag", path, "--all-cameras", "-o", out]
    code, _, err = cli(*words)
    assert (code, err) == (
        1,
        f"semcal: error: {out / 'rig.yaml'}: found another rig; choose another -o, or --force\n",
    )
    assert [file.name for file in out.iterdir()] == ["rig.yaml"]
    (out / "rig.yaml").unlink()
    os.mkfifo(out / "rig.yaml")
    for more in ([], ["--force"]):
        code, _, err = cli(*words, *more)
        assert (code, err) == (
            1,
            f"semcal: error: {out / 'rig.yaml'}: found a pipe, expected a file or nothing\n",
        )
    (out / "rig.yaml").unlink()
    (out / "rig.yaml").write_text("cameras: {mine: mine}\n")
    assert cli(*words, "--force")[0] == 0

    def depth(bag: Any, index: int, stamp: int) -> Any:
        return bag.image(COLORS[..., 0].astype("u2"), "16UC1", stamp)

    # The rig of before would join the new drive of one camera with an old one of the other.
    bad = small(tmp_path / "bad", "mcap library", **NONE, **cameras(a=image(), b=depth))
    code, _, err = cli("import", "bag", bad, "--all-cameras", "-o", out, "--force")
    assert code == 1
    assert "/b/image_raw: " in err
    assert "16UC1" in err
    assert err.endswith("; the drives of a are there\n")
    assert not (out / "rig.yaml").exists()
    del topics["b/camera_info"]
    bare = small(tmp_path / "bare", "mcap library", **NONE, **topics)
    code, _, err = cli("import", "bag", bare, "--all-cameras", "-o", tmp_path / "none")
    assert code == 1
    assert "found no camera_info beside /b/image_raw, expected one for each camera" in err


def test_the_sweeps_of_the_first_camera_are_looked_for(tmp_path: Path, cli: Cli) -> None:
    """The cameras have an image of every second sweep, of which the first one keeps five."""
    topics = cameras(left=every_second(), right=every_second())
    path, out = small(tmp_path, "mcap library", 30, **NONE, **topics), tmp_path / "out"
    code, _, err = cli("import", "bag", path, "--all-cameras", "--max-frames", "5", "-o", out)
    assert code == 0, err
    left, right = (read_drive(out / f"{name}.yaml") for name in ("left", "right"))
    assert [frame.points for frame in right.frames] == [frame.points for frame in left.frames]


def test_a_single_camera_is_no_rig(tmp_path: Path, cli: Cli) -> None:
    path = small(tmp_path, "mcap library")
    code, _, err = cli("import", "bag", path, "--all-cameras", "-o", tmp_path / "out")
    assert code == 1
    assert err.endswith("found images of /cam/image_raw alone; leave out --all-cameras\n")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("topics", "names"),
    [
        (["/front/image_raw", "/rear/image_raw/compressed"], ["front", "rear"]),
        (["/rig/cam0/image_rect", "/rig/cam1/image_rect"], ["cam0", "cam1"]),
        # What tells them apart is in the last part.
        (["/zed/image_left", "/zed/image_right"], ["zed_image_left", "zed_image_right"]),
        (["/a b/image", "/a_b/image"], ["camera_0", "camera_1"]),
        # Names of the other files, and what is no name of a file.
        (["/rig/image", "/drive/image"], ["rig_image", "drive_image"]),
        (["/rig", "/drive"], ["camera_0", "camera_1"]),
        (["/a/image", f"/{'b' * 300}/image"], ["camera_0", "camera_1"]),
    ],
)
def test_cameras_are_named_after_their_topics(topics: list[str], names: list[str]) -> None:
    images = [Topic(name, "sensor_msgs/msg/Image") for name in topics]
    assert camera_names(images) == names
