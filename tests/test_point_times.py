"""Units of point times: what cannot be seconds is refused with the unit that fits, and what can be stays."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from camera_infos import ROS
from commands import invoke, unwrapped
from dataset_imports import run_import

from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.errors import InputError
from semcal_cli.files.image_files import write_image
from semcal_cli.importing.folder import OPEN_UNIT
from semcal_cli.observations.motion import compensated
from semcal_cli.observations.reading import read_clouds

CAMERA = {"model": "plumb_bob", "width": 64, "height": 48, "K": [[40, 0, 31.5], [0, 40, 23.5], [0, 0, 1]]}
SPEED_M_S = 10.0


def drive_of(folder: Path, times: np.ndarray, gap_s: float, **keys: object) -> Drive:
    """Three sweeps of a scanner that drives along x, whose times have some unit."""
    records = np.ones(len(times), [("x", "f4"), ("y", "f4"), ("z", "f4"), ("time", times.dtype)])
    records["y"], records["time"] = np.linspace(-5.0, 5.0, len(times)), times
    np.save(folder / "a.npy", records)
    for name in "bc":
        (folder / f"{name}.npy").write_bytes((folder / "a.npy").read_bytes())
    stamps = [1000.0 + gap_s * index for index in range(3)]
    frames = [
        {"points": f"{name}.npy", "points_stamp": stamp, "image_stamp": stamp}
        for name, stamp in zip("abc", stamps, strict=True)
    ]
    motion = {"twist": {"linear_m_s": [SPEED_M_S, 0, 0], "angular_rad_s": [0, 0, 0]}}
    document = {"semcal_drive": 1, "camera": CAMERA, "frames": frames, "motion": motion, **keys}
    (folder / "drive.yaml").write_text(yaml.safe_dump(document))
    return read_drive(folder)


def farthest_m(drive: Drive) -> float:
    """How far the last point of the first sweep is moved to the time of its image."""
    return float(compensated(drive, read_clouds(drive))[0].points[-1, 0] - 1.0)


SHARES, MILLISECONDS = np.linspace(0.0, 1.0, 50), np.linspace(0.0, 100.0, 50)


@pytest.mark.parametrize(
    ("times", "gap_s", "complaint"),
    [
        (SHARES, 0.1, r"span 1 s in sweeps 0\.1 s apart, expected time_unit .*: 0\.1 if they are shares"),
        (SHARES, 3.0, r"from 0 to 1, which may be seconds or shares of a sweep, expected time_unit"),
        (SHARES, 1.0, r"from 0 to 1, which may be seconds or shares of a sweep, expected time_unit"),
        (SHARES, 0.5, r"from 0 to 1, which may be seconds or shares of a sweep, expected time_unit"),
        (
            SHARES,
            0.2,
            r": 0\.2 if they are shares of a sweep of 0\.2 s, 0\.1 if every second sweep is left out",
        ),
        (0.5 * SHARES, 0.1, r"span 0\.5 s in sweeps 0\.1 s apart, expected time_unit"),
        (MILLISECONDS, 0.1, r"span 100 s, 0\.1 s as ms, expected time_unit: ms in drive\.yaml"),
        (1e3 * MILLISECONDS, 3.0, r"span 1e\+05 s, 0\.1 s as us, expected time_unit: us"),
        ((1e3 * MILLISECONDS).astype("u4"), 3.0, r"span 0\.0001 s, 0\.1 s as us, expected time_unit: us"),
        (
            1000.0 + 0.1 * SHARES,
            0.1,
            r"expected them within 1 s; motion\.point_times is relative, and absolute would",
        ),
    ],
)
def test_what_cannot_be_seconds_is_refused(
    times: np.ndarray, gap_s: float, complaint: str, tmp_path: Path
) -> None:
    drive = drive_of(tmp_path, times, gap_s)
    with pytest.raises(InputError, match=complaint):
        farthest_m(drive)
    inspected = invoke("inspect", tmp_path)
    assert inspected.exit_code == 0
    assert "found point times" in inspected.stdout


@pytest.mark.parametrize(
    ("times", "gap_s", "unit", "seconds"),
    [
        (SHARES, 1.0, "s", 1.0),  # a slow scanner, sweep after sweep
        (1.5 * SHARES - 0.75, 1.5, None, 0.75),
        (SHARES, 3.0, "s", 1.0),
        (SHARES, 0.1, 0.1, 0.1),
        (MILLISECONDS, 0.1, "ms", 0.1),
        ((1e3 * MILLISECONDS).astype("u4"), 0.1, "us", 0.1),
        ((1e6 * MILLISECONDS).astype("u4"), 0.1, None, 0.1),
        (0.1 * SHARES - 0.1, 0.1, None, 0.0),  # before the stamp
    ],
)
def test_times_in_their_unit_move_points_right(
    times: np.ndarray, gap_s: float, unit: object, seconds: float, tmp_path: Path
) -> None:
    drive = drive_of(tmp_path, times, gap_s, **({} if unit is None else {"time_unit": unit}))
    assert farthest_m(drive) == pytest.approx(SPEED_M_S * seconds, abs=1e-4)


def test_the_stated_spin_of_a_slow_scanner_says_that_its_times_are_seconds(tmp_path: Path) -> None:
    spin = {"rate_hz": 1.0, "clockwise": True, "seam_deg": 0.0}
    lidar = {"channels": 2, "columns": 50, "fov_up_deg": 1.0, "fov_down_deg": -1.0, "spin": spin}
    assert farthest_m(drive_of(tmp_path, SHARES, 1.0, lidar=lidar)) == pytest.approx(SPEED_M_S, abs=1e-4)


def test_few_frames_keep_the_time_between_all_sweeps(tmp_path: Path) -> None:
    drive = drive_of(tmp_path, SHARES, 0.1)
    few = drive.model_copy(update={"frames": drive.frames[::2]})
    with pytest.raises(InputError, match=r"sweeps 0\.1 s apart"):
        farthest_m(few)
    # Nor do labels that are made on the way make another drive of it.
    labelled = (
        "calibrate",
        tmp_path,
        "--image-model",
        "net.onnx",
        "--max-frames",
        1,
        "-o",
        tmp_path / "o.yaml",
    )
    assert "sweeps 0.1 s apart" in str(invoke(*labelled).exception)


@pytest.mark.parametrize(
    ("times", "step", "options", "expected"),
    [
        (MILLISECONDS, 1, (), "ms"),
        (SHARES, 1, (), 0.1),
        (SHARES, 1, ("--time-unit", "0.05"), 0.05),
        (SHARES, 1, ("--time-unit", "s"), "s"),
        (0.1 * SHARES, 1, (), None),
        (SHARES, 2, (), OPEN_UNIT),  # of every second sweep
        (SHARES, 5, (), OPEN_UNIT),
    ],
)
def test_an_import_states_the_unit(
    times: np.ndarray, step: int, options: tuple[str, ...], expected: object, tmp_path: Path
) -> None:
    drive_of(tmp_path, times, 0.1)
    for tenth in range(0, 3 * step, step):
        (tmp_path / f"160000000{tenth // 10}.{tenth % 10}.npy").write_bytes((tmp_path / "a.npy").read_bytes())
        write_image(np.zeros((32, 64, 3), np.uint8), tmp_path / f"160000000{tenth // 10}.{tenth % 10}.png")
    (tmp_path / "camera.yaml").write_text(ROS)
    files = ("--points", tmp_path / "16*.npy", "--images", tmp_path / "16*.png")
    written = run_import(
        "folder", *files, "--camera-info", tmp_path / "camera.yaml", *options, "-o", tmp_path / "d"
    )
    is_open = expected == OPEN_UNIT
    assert read_drive(tmp_path / "d").time_unit == (None if is_open else expected)
    assert (OPEN_UNIT in unwrapped(written, 6)) == is_open
    assert ("note: point times:" in written) == (expected is not None and not options)
