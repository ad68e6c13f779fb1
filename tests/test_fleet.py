"""Many calibrations of one rig: their mean, who disagrees, and when the rig changed."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import make_pose
from fleets import SIGMAS, TRUTH, fleet, fleet_drives, series_of

from semcal_cli.config import Limits
from semcal_cli.errors import CalibrationError
from semcal_cli.fleet.combination import combine_drives
from semcal_cli.fleet.consensus import extra_scatter, robust_mean
from semcal_cli.fleet.fleet_drives import FleetDrive, read_fleet_drives
from semcal_cli.fleet.fleet_result import Offset, describe_fleet
from semcal_cli.fleet.fleet_verdict import SIGNS, motions
from semcal_cli.fleet.history import change_points, fit_drift
from semcal_cli.geometry.poses import inverse
from semcal_cli.geometry.twists import local_coordinates, pose_at
from semcal_cli.result.calibration_document import CalibrationDocument
from semcal_cli.result.provenance import camera_hash

MANY = 1e6


def test_the_mean_is_as_sure_as_it_says_and_outliers_do_not_move_it() -> None:
    squared = []
    for seed in range(60):
        poses, covariances, _ = fleet(np.random.default_rng(seed), 12)
        for number, far in enumerate((0.5, -0.3, 2.0)):
            poses[number] = make_pose((0.1, 0.2, far), (1.0, 2.0, 3.0)) @ TRUTH
        mean = robust_mean(poses, covariances)
        (off,) = local_coordinates([mean.T_camera_lidar], TRUTH)
        squared.append(float(off @ np.linalg.inv(mean.covariance) @ off))
    # Six degrees of freedom: a mean of 6, within what 60 draws allow and what Student's weights cost.
    assert 4.5 < np.mean(squared) < 7.5


def test_scatter_beyond_what_is_stated_is_found_even_where_the_rig_changed() -> None:
    for extra in (0.0, 3.0):
        _, covariances, series = fleet(np.random.default_rng(1), 400, extra)
        series[200:] += 30.0 * SIGMAS
        ratios = np.sqrt(extra_scatter(series, covariances).variances) / SIGMAS
        assert ratios == pytest.approx(np.full(6, extra), rel=0.15, abs=0.5)


def test_drives_that_agree_to_the_bit_have_no_extra_scatter() -> None:
    _, covariances, series = fleet(np.random.default_rng(1), 5)
    scatter = extra_scatter(np.zeros_like(series), covariances)
    assert np.array_equal(scatter.variances, np.zeros(6))
    assert np.array_equal(scatter.degrees_of_freedom, np.full(6, 4.0))


def test_a_change_is_found_where_it_happened() -> None:
    _, covariances, series = fleet(np.random.default_rng(2), 60)
    series[20:, 4] += np.radians(0.2)
    series[45:, 0] += 0.03
    assert change_points(series, covariances, MANY) == pytest.approx([20, 45], abs=1)


@pytest.mark.parametrize("place", [0, 1, 12, 28, 29])
def test_one_that_lies_alone_is_neither_a_change_nor_a_drift(place: int) -> None:
    """Not even the last: a bad drive last night does not move the rig."""
    for seed in range(10):
        drives = series_of("nothing", 30, seed)
        off = np.array([0.2, 0.0, 0.0, 0.0, np.radians(0.8), 0.0])
        drives[place] = replace(drives[place], T_camera_lidar=pose_at(drives[place].T_camera_lidar, off))
        result = combine_drives(drives, Limits())
        assert (result.verdict, len(result.parts), result.drift) == ("fail", 1, None)
        (far,) = [drive.drive.name for drive in result.drives if drive.is_far]
        assert far == drives[place].name
        (now,) = local_coordinates([result.T_camera_lidar], TRUTH)
        assert np.abs(now / SIGMAS).max() < 1.5


@pytest.mark.parametrize("share", [0.1, 0.15, 0.2])
def test_many_that_lie_alone_do_not_hide_one_another(share: float) -> None:
    for seed in range(5):
        drives = series_of("nothing", 40, seed)
        wrong = np.arange(1, 40, round(1.0 / share))
        for place in wrong:
            drives[place] = replace(drives[place], T_camera_lidar=make_pose((0.3, 0, 0), (1, 0, 0)) @ TRUTH)
        result = combine_drives(drives, Limits())
        far = [index for index, drive in enumerate(result.drives) if drive.verdict == "fail"]
        assert far == wrong.tolist()
        assert result.scatter[3:].max() < np.degrees(4.0 * SIGMAS[3:].max())


def turn_camera(drives: list[FleetDrive], place: int, turn_deg: float, axis: int = 4) -> None:
    """Turn the camera of a drive about one of its axes."""
    T = drives[place].T_camera_lidar
    assert T is not None
    twist = np.radians(turn_deg) * np.eye(6)[axis]
    drives[place] = replace(drives[place], T_camera_lidar=pose_at(T, twist))


@pytest.mark.parametrize("count", [5, 6, 8, 12])
def test_few_drives_of_which_one_is_off_do_not_pass(count: int) -> None:
    """What few drives cannot tell from scatter is at least not called good, and named."""
    for seed in range(10):
        for places in ([count // 2], [count - 1], list(range(count // 2, count))):
            drives = series_of("nothing", count, seed)
            for place in places:
                turn_camera(drives, place, 0.8)
            result = combine_drives(drives, Limits())
            assert result.verdict != "pass"
            assert result.reasons


def test_small_changes_add_up() -> None:
    drives = series_of("nothing", 40)
    for index in range(40):
        turn_camera(drives, index, 0.25 * (index // 10), axis=5)
    assert combine_drives(drives, Limits()).verdict == "fail"


def test_drives_are_in_the_order_of_stamps_that_compare_or_else_of_names() -> None:
    drives = series_of("change")
    by_name = [replace(drive, stamp=12.3, name=f"drive_{i}") for i, drive in enumerate(drives)]
    result = combine_drives(by_name[::-1], Limits())
    assert (result.order, result.parts[1].first, result.verdict) == (
        "name",
        "drive_15",
        "fail",
    )
    assert result.notes == ("ordered by name: some drives have no absolute timestamps",)
    at_once = [replace(drive, stamp=drives[0].stamp) for drive in drives]
    for stamped in (drives, drives[:1], at_once):
        assert combine_drives(stamped, Limits()).notes == ()


def test_cameras_that_differ_are_told() -> None:
    drives = [replace(drive, camera=f"k{index % 2}") for index, drive in enumerate(series_of("nothing"))]
    assert combine_drives(drives, Limits()).notes == (
        "drives have 2 cameras, given or estimated, that differ in image size, intrinsics or lens model. The pose that "
        "they agree on belongs to none of them: write one camera into all drives and calibrate them again",
    )
    assert combine_drives([replace(drive, camera="k0") for drive in drives], Limits()).notes == ()


def test_a_single_result_has_the_camera_that_was_estimated(
    refined: CalibrationDocument, refined_file: Path, rejected_file: Path
) -> None:
    (kept,), (rejected,) = read_fleet_drives([refined_file]), read_fleet_drives([rejected_file])
    assert kept.camera == camera_hash(refined.used_camera)
    assert rejected.camera == camera_hash(refined.input.camera)


def test_a_drift_is_measured() -> None:
    times = np.linspace(0.0, 100.0, 40)
    rate = np.array([1e-4, 0.0, 0.0, 0.0, 2e-5, 0.0])
    off, alarms = [], 0
    for seed in range(40):
        _, covariances, series = fleet(np.random.default_rng(seed), 40)
        alarms += fit_drift(times, series, covariances, MANY).is_significant
        line = fit_drift(times, series + times[:, None] * rate, covariances, MANY)
        assert line.is_significant
        off.append((line.per_unit - rate) / np.sqrt(np.diag(line.covariance)))
    assert 0.8 < np.std(off) < 1.25
    assert alarms <= 3  # at a level of 1 %


@pytest.mark.parametrize(("count", "extra"), [(3, 3.0), (5, 1.0), (8, 3.0), (20, 1.0), (60, 0.0)])
def test_intervals_hold_the_truth_and_nothing_is_seen_where_nothing_is(count: int, extra: float) -> None:
    """Intervals of 95 %, whether drives scatter as they say or by four times as much; 60 fleets, 360 axes each."""
    held, widths, errors, alarms = [], [], [], 0
    for seed in range(60):
        poses, covariances, _ = fleet(np.random.default_rng((count, seed)), count, extra)
        result = combine_drives(fleet_drives(poses, covariances), Limits())
        (off,) = local_coordinates([result.T_camera_lidar], TRUTH)
        off_m_deg = np.concatenate([off[:3], np.degrees(off[3:])])
        held.append(np.abs(off_m_deg) <= result.parts[-1].half_widths)
        alarms += len(result.parts) > 1 or result.drift is not None
        alarms += any(drive.disagrees for drive in result.drives)
        widths.append(result.parts[-1].half_widths)
        errors.append(off_m_deg)
    assert np.mean(held) >= 0.90
    assert alarms <= 3
    # Nor are they wide for nothing: as wide as errors want them to be, but for what few drives do not tell.
    wanted = 1.96 * np.std(errors, axis=0)
    assert (np.median(widths, axis=0) < {3: 5.0, 5: 2.5}.get(count, 1.7) * wanted).all()


@pytest.mark.parametrize(
    ("kind", "verdict", "num_parts", "has_drift"),
    [
        ("nothing", "pass", 1, False),
        ("change", "fail", 2, False),
        ("small change", "pass", 2, False),
        ("drift", "fail", 1, True),
        ("outlier", "fail", 1, False),
    ],
)
def test_what_happened_is_told(kind: str, verdict: str, num_parts: int, has_drift: bool) -> None:
    result = combine_drives(series_of(kind), Limits())
    assert (result.verdict, len(result.parts), result.drift is not None) == (
        verdict,
        num_parts,
        has_drift,
    )
    disagreeing = [drive.drive.name for drive in result.drives if drive.disagrees]
    assert disagreeing == (["009"] if kind == "outlier" else [])
    if kind == "change":
        assert result.parts[1].first == "015"
        assert re.fullmatch(
            r"changed between 014 and 015: 8\.\d cm up \(\+- 0\.\d\), \+0\.6\d degrees yaw \(\+- 0\.0\d\)",
            result.reasons[0],
        )
    (off,) = local_coordinates([result.T_camera_lidar], TRUTH)
    now = {
        "change": [0, 0.08, 0, 0, 0.6, 0],
        "drift": [0, 0, 0, 0.8, 0, 0],
        "small change": [0] * 4 + [0.22, 0],
    }
    off[3:] = np.degrees(off[3:])
    assert np.abs(off - now.get(kind, [0.0] * 6)).max() < 0.06


@pytest.mark.parametrize("name", [None, "0" * 30 + "1"])
def test_the_order_is_that_of_time_and_else_nothing_depends_on_order(name: str | None) -> None:
    """Nor where names, which stand for stamps that are missing, differ in zeros alone."""
    drives = series_of("change")
    if name is not None:
        drives = [replace(drive, stamp=None, name=name[-i - 1 :]) for i, drive in enumerate(drives)]
    one = combine_drives(drives, Limits())
    other = combine_drives([drives[i] for i in np.random.default_rng(1).permutation(24)], Limits())
    assert describe_fleet(one, {}) == describe_fleet(other, {})


def test_a_reference_is_judged() -> None:
    result = combine_drives(series_of("nothing"), Limits(), pose_at(TRUTH, np.array([0.1, 0, 0, 0, 0, 0])))
    assert result.verdict == "fail"
    assert [c.name for c in result.checks if c.verdict == "fail"] == [
        "from the reference: camera centre x",
        "from the reference: camera centre overall",
    ]
    (offset,) = [c.offset for c in result.checks if c.name == "from the reference: camera centre x"]
    assert offset == pytest.approx(10.0, abs=0.5)  # rho moves the centre the other way, here the reference's


def test_too_few_drives_decide_nothing() -> None:
    result = combine_drives(series_of("nothing")[:2], Limits())
    assert result.verdict == "inconclusive"
    mostly_out = [replace(drive, left_out="not trusted") for drive in series_of("nothing")[:14]]
    result = combine_drives([*mostly_out, *series_of("nothing")[14:]], Limits())
    assert (result.verdict, result.reasons) == (
        "inconclusive",
        ("10 of 24 drives can be used, needed 50%",),
    )
    with pytest.raises(CalibrationError, match="found no usable drive among 14, needed 3; the first, 000"):
        combine_drives(mostly_out, Limits())


def test_one_stamp_that_is_missing_is_no_reason_to_pass() -> None:
    drives = series_of("nothing")
    drives[5] = replace(drives[5], stamp=None)
    result = combine_drives(drives, Limits())
    assert result.verdict == "inconclusive"
    assert result.reasons == ("1 of 24 drives have no absolute timestamp, so the order in time is unknown",)


@pytest.mark.parametrize(
    ("axis", "off", "half_width", "words"),
    [
        (0, 0.0803, 0.0041, "8.0 cm to the right (+- 0.4)"),
        (0, -0.0803, 0.0014, "8.03 cm to the left (+- 0.14)"),
        (1, 0.02, 0.0004, "2.00 cm down (+- 0.04)"),
        (2, -0.02, 0.004, "2.0 cm back (+- 0.4)"),
        (3, 0.6, 0.021, "+0.60 degrees pitch (+- 0.02)"),
        (4, -0.6, 0.0149, "-0.600 degrees yaw (+- 0.015)"),
        (5, 0.601, 0.3, "+0.60 degrees roll (+- 0.30)"),
    ],
)
def test_an_offset_in_words(axis: int, off: float, half_width: float, words: str) -> None:
    offsets, half_widths = np.zeros(6), np.full(6, 1.0)
    offsets[axis], half_widths[axis] = off, half_width
    assert motions(Offset(offsets, half_widths)) == words


def test_what_chance_may_explain_is_told_only_if_nothing_else_is() -> None:
    values, half_widths = np.array([0.02, 0.0, 0.03, 0.0, 0.0, 0.0]), np.full(6, 0.01)
    assert motions(Offset(values, half_widths)) == "3.0 cm forward (+- 1.0), 2.0 cm to the right (+- 1.0)"
    assert motions(Offset(0.1 * values, half_widths)) == "0.3 cm forward (+- 1.0)"


def test_signs_of_rotations_are_those_that_the_page_states() -> None:
    """A positive pitch moves what is ahead up, a positive yaw to the right; a roll turns what is at the right down."""
    assert "pitch moves what the camera sees up" in SIGNS
    ahead, aside = (inverse(TRUTH) @ point for point in ([0.0, 0.0, 10.0, 1.0], [1.0, 0.0, 10.0, 1.0]))
    turned = [pose_at(TRUTH, np.eye(6)[axis] * 0.01) for axis in (3, 4, 5)]
    assert (turned[0] @ ahead)[1] == pytest.approx(-0.1, rel=1e-3)
    assert (turned[1] @ ahead)[0] == pytest.approx(0.1, rel=1e-3)
    assert (turned[2] @ aside)[1] == pytest.approx(0.01, rel=1e-3)


def test_no_number_of_drives_reduces_errors_of_k() -> None:
    poses, covariances, _ = fleet(np.random.default_rng(5), 24)
    alone = fleet_drives(poses, covariances)
    of_k = np.diag([0.01, 0.01, 0.01, 0.002, 0.002, 0.002]) ** 2
    apart, shared = (
        combine_drives(drives, Limits())
        for drives in (alone, [replace(drive, covariance_of_intrinsics=of_k) for drive in alone])
    )
    np.testing.assert_allclose(shared.T_camera_lidar, apart.T_camera_lidar)
    np.testing.assert_allclose(shared.covariance, apart.covariance + of_k)
    assert (shared.parts[-1].half_widths > apart.parts[-1].half_widths).all()
