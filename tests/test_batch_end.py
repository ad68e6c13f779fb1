"""The end of a batch on the terminal: verdicts, drives that need a look, the agreed pose, and what is next."""

from pathlib import Path

import numpy as np
import pytest
from conftest import make_pose
from fleets import TRUTH, fleet
from rich.console import Console

from semcal_cli.cli.batch_progress import MAX_NAMED, BatchProgress, print_end
from semcal_cli.cli.tables import COLUMNS
from semcal_cli.config import Limits
from semcal_cli.fleet.combination import combine_drives
from semcal_cli.fleet.fleet_drives import read_fleet_drives
from semcal_cli.geometry.poses import camera_center
from semcal_cli.many.batch.records import write_summary
from semcal_cli.many.batch.tasks import Outcome, failed_outcome
from semcal_cli.readable import signed
from semcal_cli.result.uncertainty import widest


def trusted_drives(count: int) -> list[Outcome]:
    """Drives of one rig that scatter as they say."""
    poses, covariances, _ = fleet(np.random.default_rng(4), count)
    return [
        Outcome(
            drive=f"drives/{number:03d}",
            status="trusted",
            exit_code=0,
            reasons=(),
            stamp=None,
            T_camera_lidar=T.tolist(),
            covariance=covariance.tolist(),
            mutual_information_nats=None,
            camera="one",
            result=f"drives/{number:03d}/calibration.yaml",
        )
        for number, (T, covariance) in enumerate(zip(poses, covariances, strict=True))
    ]


def untrusted_outcome(number: int, reason: str = "the pose is determined in no direction") -> Outcome:
    return failed_outcome(f"drives/bad_{number:02d}", reason).model_copy(
        update={"status": "not_trusted", "exit_code": 3, "T_camera_lidar": TRUTH.tolist()}
    )


def end_of(
    outcomes: list[Outcome], folder: Path, capsys: pytest.CaptureFixture[str], **console: bool
) -> list[str]:
    folder.mkdir(exist_ok=True)
    write_summary(outcomes, folder)
    print_end(Console(highlight=False, soft_wrap=True, **console), outcomes, folder)
    return capsys.readouterr().out.splitlines()


def test_the_end_names_what_matters(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    reason = (
        "drives/broken/points/000000.bin: found 1,921 bytes, expected a multiple of 16, which is what a point "
        "takes"
    )
    outcomes = [*trusted_drives(6), untrusted_outcome(1), failed_outcome("drives/broken", reason)]
    lines = end_of(outcomes, Path("out"), capsys)
    assert lines[:6] == [
        "8 of 8 drives: 1 failed, 1 not trusted, 6 trusted",
        "failed        drives/broken",
        "              points/000000.bin: found 1,921 bytes, expected a multiple of 16,",
        "              which is what a point takes",
        "not trusted   drives/bad_01",
        "              the pose is determined in no direction",
    ]
    fleet_result = combine_drives(
        [drive for drive in read_fleet_drives([Path("out")]) if drive.left_out is None], Limits()
    )
    half = fleet_result.parts[-1].half_widths
    assert lines[6] == f"agreed pose      of 6 trusted drives: {signed(widest(half.tolist()))}"
    place = lines[7].removeprefix("camera at").removesuffix("m in the LiDAR frame").split()
    np.testing.assert_allclose(list(map(float, place)), camera_center(fleet_result.T_camera_lidar), atol=1e-6)
    assert np.linalg.norm(camera_center(fleet_result.T_camera_lidar) - camera_center(TRUTH)) < 0.01
    assert lines[-2:] == [
        "summary          out/summary.csv, out/summary.jsonl",
        "next             semcal fleet out --report fleet.html",
    ]
    assert max(map(len, lines)) <= COLUMNS
    assert "nats" not in "\n".join(lines)


def test_most_of_many_bad_drives_are_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = end_of([untrusted_outcome(number) for number in range(30)], tmp_path / "out", capsys)
    assert lines[0] == "30 of 30 drives: 30 not trusted"
    assert sum(line.startswith("not trusted") for line in lines) == MAX_NAMED
    assert f"and {30 - MAX_NAMED} more: see {tmp_path}/out/summary.csv" in lines
    assert not any(line.startswith(("agreed pose", "next")) for line in lines)


@pytest.mark.parametrize(
    ("count", "change", "expected"),
    [
        (1, {}, None),
        (2, {}, "note             2 of 2 drives can be used, needed 3 to show their scatter"),
        (
            3,
            {"camera": "two"},
            "note             the drives have 2 different cameras, given or estimated",
        ),
        (3, {"covariance": ((0.0,) * 6,) * 6}, "agreed pose      none:"),
    ],
)
def test_a_pose_that_drives_do_not_agree_on(
    count: int, change: dict, expected: str | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    *others, last = trusted_drives(count)
    lines = end_of([*others, last.model_copy(update=change)], tmp_path / "out", capsys)
    if expected is None:
        assert not any("agreed" in line for line in lines)
    else:
        assert any(line.startswith(expected) for line in lines)


def test_drives_of_different_rigs_are_listed_by_the_pose_that_they_agree_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    of_rigs = trusted_drives(5)
    elsewhere = (TRUTH @ make_pose((0.0, 0.0, 1.5), (0.6, 0.0, 0.0))).tolist()
    outcomes = [
        outcome.model_copy(update={"T_camera_lidar": elsewhere}) if number in (1, 3) else outcome
        for number, outcome in enumerate(of_rigs)
    ]
    lines = end_of(outcomes, tmp_path / "out", capsys)
    assert lines[1] == "agreed pose      none: 5 trusted drives fall into 2 groups that differ"
    assert lines[2] == "group 1          3 drives: drives/000, drives/002, drives/004"
    assert "group 2          2 drives: drives/001, drives/003" in lines
    assert "±" not in "".join(lines)


def test_colours_are_for_terminals(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    outcomes = [*trusted_drives(1), untrusted_outcome(1, "[red]no markup[/red]")]
    colored = "\n".join(
        end_of(outcomes, tmp_path / "out", capsys, force_terminal=True, color_system="standard")
    )
    assert "\x1b[1;31m1 not trusted\x1b[0m, \x1b[1;32m1 trusted\x1b[0m" in colored
    assert "[red]no markup[/red]" in colored
    assert "\x1b" not in "\n".join(end_of(outcomes, tmp_path / "out", capsys))


def test_the_progress_names_running_and_finished_drives() -> None:
    show = BatchProgress(5, 2, quiet=True)
    for name in ("drives/000", "drives/bad_01", "drives/003"):
        show.begin(name)
    show.tell(trusted_drives(1)[0], True)
    show.tell(untrusted_outcome(1), True)
    show.tell(untrusted_outcome(2).model_copy(update={"drive": "drives/before"}), False)
    lines = [line.plain for line in show._lines()]
    assert lines == [
        "3 of 5 drives   2 not trusted, 1 trusted   about 1 s left",
        "      0:00  drives/003",
        "trusted       drives/000",
        "not trusted   drives/bad_01: the pose is determined in no direction",
    ]
