"""The commands of docs/recordings.md."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from bag_imports import run_cli
from bags import write_drive_as_bag
from networks import color_network

from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.geometry.poses import rotation_error_deg

DOCUMENT = Path(__file__).parents[1] / "docs/recordings.md"


def tutorial() -> list[list[str]]:
    """The commands of the first block of the documentation."""
    block = re.search(r"```sh\n(.*?)```", DOCUMENT.read_text(), re.DOTALL)
    assert block is not None
    return [shlex.split(line) for line in block[1].splitlines()]


PAINT = np.stack(np.meshgrid(*[[10, 90, 170, 250]] * 3), axis=-1).reshape(-1, 3).astype(np.uint8)
"""Red, green, blue of each id."""


def test_the_commands_of_the_tutorial(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Images whose colours are their classes, and a network that knows them."""
    size = ["--width", "480", "--height", "270", "--channels", "64", "--columns", "800"]
    run_cli("synth", tmp_path / "true", "--frames", "8", "--seed", "93002", *size)
    drive = read_drive(tmp_path / "true")
    for frame in drive.frames:
        ids = cv2.imread(str(drive.resolve(frame.image_labels or "")), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(drive.resolve(frame.image or "")), np.ascontiguousarray(PAINT[ids][:, :, ::-1]))
    recorded = write_drive_as_bag(drive, tmp_path, "mcap library")
    recorded.rename(tmp_path / "recording.mcap")
    color_network(tmp_path / "network.onnx", colors=PAINT)
    card = {"semcal_image_model": 1, "scale": 1 / 255, "mean": [0, 0, 0], "std": [1, 1, 1]}
    (tmp_path / "network.yaml").write_text(yaml.safe_dump(card))
    monkeypatch.chdir(tmp_path)
    commands = tutorial()
    assert [command[1] for command in commands] == ["import", "label", "calibrate", "convert"]
    for program, *arguments in commands:
        assert program == "semcal"
        # No hub is reached from here.
        arguments = ["network.onnx" if each == "cityscapes" else each for each in arguments]
        run_cli(*arguments, code=None if arguments[0] == "calibrate" else 0)
    T_camera_lidar = np.array(yaml.safe_load(Path("calibration.yaml").read_text())["T_camera_lidar"])
    assert rotation_error_deg(T_camera_lidar, np.array(drive.T_camera_lidar)) < 1.0
    assert "static_transform_publisher" in Path("static_transform.sh").read_text()


def test_a_drive_in_the_rerun_viewer(synthetic: Drive, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    run_cli("calibrate", synthetic.path, "-o", tmp_path / "calibration.yaml", code=None)
    run_cli("export", "rerun", synthetic.path, tmp_path / "calibration.yaml", "-o", tmp_path / "look.rrd")
    rerun = [sys.executable, "-m", "rerun", "rrd", "print", str(tmp_path / "look.rrd"), "-v"]
    printed = subprocess.run(rerun, capture_output=True, text=True, check=True).stdout
    names = [
        "reference",
        "hypothesis_0",
        "stage_initial",
        "stage_polished",
        "result/image",
        "result/labels",
    ]
    for entity in ("lidar/points", *(f"lidar/cameras/{name}" for name in names)):
        assert f"/{entity}" in printed
    assert run_cli("export", "rerun", synthetic.path, "-o", tmp_path / "look.txt", code=1)
