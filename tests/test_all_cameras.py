"""`semcal import bag --all-cameras`: a drive of each camera of a recording, of the same sweeps, and a rig."""

import shlex
from pathlib import Path

import numpy as np
import pytest
from bag_imports import COLORS, Maker, image, info, small
from conftest import Cli

from semcal_cli.drive.document import read_drive
from semcal_cli.importing.bags.all_cameras import camera_names
from semcal_cli.importing.bags.messages import Topic
from semcal_cli.many.rig.rig_document import find_rig

NONE = {"info": lambda *about: None, "image": lambda *about: None}


def grey_every_second() -> Maker:
    """Make images of another camera that is half as fast."""
    return lambda bag, index, stamp: (
        bag.image(np.roll(COLORS, -index, 1), "bgr8", stamp) if index % 2 == 0 else None
    )


def test_all_cameras_become_a_rig_with_the_same_sweeps(tmp_path: Path, cli: Cli) -> None:
    cameras = {
        "left/camera_info": info(),
        "left/image_raw": image(),
        "right/camera_info": info(),
        "right/image_raw": grey_every_second(),
    }
    path = small(tmp_path, "mcap library", 12, **NONE, **cameras)
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
        (["/rig/cam0/image_rect", "/rig/cam1/image_rect"], ["rig_cam0", "rig_cam1"]),
        # What tells them apart is in the last part.
        (["/zed/image_left", "/zed/image_right"], ["zed_image_left", "zed_image_right"]),
        (["/a b/image", "/a_b/image"], ["camera_0", "camera_1"]),
    ],
)
def test_cameras_are_named_after_their_topics(topics: list[str], names: list[str]) -> None:
    images = [Topic(name, "sensor_msgs/msg/Image") for name in topics]
    assert camera_names(images) == names
