import json
from pathlib import Path

import numpy as np
import pytest
from commands import invoke

from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError
from semcal_cli.observations.frame_naming import frame_names
from semcal_cli.observations.frame_selection import (
    chosen_frames,
    farthest_points,
    num_different,
    select_frames,
)


def test_rows_that_differ_are_chosen_before_rows_that_repeat() -> None:
    same, near, far = np.zeros(10), np.eye(10)[0], np.ones(10)
    rows = np.array([same, same, near, same, far]).astype(np.uint16)
    assert farthest_points(rows, 2, num_different) == [0, 4]
    assert farthest_points(rows, 3, num_different) == [0, 2, 4]
    assert farthest_points(rows, 5, num_different) == [0, 1, 2, 3, 4]


def test_a_long_drive_keeps_its_order_and_a_short_one_everything(street: Path) -> None:
    drive = read_drive(street)
    assert select_frames(drive, 4) is drive
    twice = drive.model_copy(update={"frames": drive.frames[:2] + drive.frames[:2] + drive.frames[2:]})
    assert select_frames(twice, 4).frames == drive.frames


def test_frames_are_chosen_and_left_out(street: Path) -> None:
    drive = read_drive(street)
    names = frame_names([frame.points for frame in drive.frames])
    left = chosen_frames(drive, slice(1, None, 2), [names[1]]).frames
    assert left == drive.frames[3::2]
    assert chosen_frames(drive, None, [drive.frames[0].points]).frames == drive.frames[1:]
    with pytest.raises(InputError, match=rf"--exclude: found no frame 'x', expected one of: {names[0]}, "):
        chosen_frames(drive, None, ["x"])
    with pytest.raises(
        InputError, match=r"--frames and --exclude: found no frame that is left of \d+ frames"
    ):
        chosen_frames(drive, slice(0, 1), [names[0]])
    with pytest.raises(InputError, match=r"yaml: --frames: found no frame that is left of \d+ frames"):
        chosen_frames(drive, slice(20, 30), [])
    with pytest.raises(InputError, match=r"yaml: --exclude: found no frame that is left of \d+ frames"):
        chosen_frames(drive, None, names)
    twice = drive.model_copy(update={"frames": (*drive.frames, drive.frames[0])})
    assert chosen_frames(twice, None, [drive.frames[0].points]).frames == drive.frames[1:]
    pair = drive.model_copy(update={"frames": drive.frames[:1] * 2})
    with pytest.raises(InputError, match=rf"'x', expected {drive.frames[0].points}$"):
        chosen_frames(pair, None, ["x"])
    run = invoke(
        "calibrate", street, "--frames", "0:3", "--exclude", names[1], "--no-polish", "--json", "--quiet"
    )
    used = [frame["points"] for frame in json.loads(run.stdout)["input"]["frames"]]
    assert used == [drive.frames[0].points, drive.frames[2].points]


def test_long_names_that_begin_alike_are_told_apart(street: Path) -> None:
    drive = read_drive(street)
    folder = "2011_09_26_drive_0027_sync/velodyne_points/data"
    frames = [
        frame.model_copy(update={"points": f"{folder}/{index}/cloud.bin"})
        for index, frame in enumerate(drive.frames)
    ]
    few = drive.model_copy(update={"frames": tuple(frames[:2])})
    with pytest.raises(
        InputError, match=r"expected one of: \.\.\.ts/data/0/cloud\.bin, \.\.\.ts/data/1/cloud\.bin$"
    ):
        chosen_frames(few, None, ["x"])


def test_a_missing_label_image_is_named(street: Path) -> None:
    drive = read_drive(street)
    frames = (*drive.frames[:3], drive.frames[3].model_copy(update={"image_labels": None}))
    with pytest.raises(InputError, match=r"frames\[.*3\.bin\].image_labels: found nothing, expected"):
        select_frames(drive.model_copy(update={"frames": frames}), 2)
