"""Many calibrations of one rig: their mean, who disagrees, and when the rig changed."""

import json
import re
from dataclasses import fields, replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from click.testing import CliRunner, Result
from conftest import make_pose
from scipy.spatial.transform import Rotation

from semcal_cli.batch.tasks import Outcome
from semcal_cli.cli import semcal
from semcal_cli.config import Limits
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.files.documents import read_document
from semcal_cli.fleet.changes import ALPHA, change_points, drift
from semcal_cli.fleet.combination import combine_drives
from semcal_cli.fleet.consensus import extra_scatter, robust_mean
from semcal_cli.fleet.members import Member, _Line
from semcal_cli.fleet.record import describe_fleet
from semcal_cli.formats import read_transform
from semcal_cli.geometry.poses import Pose, camera_center
from semcal_cli.geometry.twists import local_coordinates, pose_at

TRUTH = make_pose((1.2, -0.3, 0.8), (0.4, -0.2, 0.7))
MANY = 1e6
SIGMAS = np.array([0.004, 0.003, 0.006, *np.radians([0.02, 0.03, 0.01])])


def fleet(
    rng: np.random.Generator, count: int, extra: float = 0.0
) -> tuple[list[Pose], np.ndarray, np.ndarray]:
    """Calibrations that scatter as they say, and by `extra` times as much again; covariances; coordinates."""
    scales = rng.uniform(0.5, 2.0, count)
    off = rng.standard_normal((count, 6)) * SIGMAS * scales[:, None]
    off += extra * rng.standard_normal((count, 6)) * SIGMAS
    covariances = np.array([np.diag((SIGMAS * scale) ** 2) for scale in scales])
    return [pose_at(TRUTH, each) for each in off], covariances, off


def test_coordinates_are_those_of_the_calibration_s_uncertainty() -> None:
    """Along the camera's axes: rho is minus the motion of its centre, phi the turn that is put before the rotation."""
    T = TRUTH.copy()
    turn = Rotation.from_rotvec([0.0, 0.01, 0.0]).as_matrix()
    T[:3, :3] = turn @ TRUTH[:3, :3]
    center = camera_center(TRUTH) + TRUTH[:3, :3].T @ [0.0, 0.0, 0.05]
    T[:3, 3] = -T[:3, :3] @ center
    (found,) = local_coordinates([T], TRUTH)
    assert found == pytest.approx([0.0, 0.0, -0.05, 0.0, 0.01, 0.0], abs=1e-12)
    assert pose_at(TRUTH, found) == pytest.approx(T, abs=1e-12)


def test_coordinates_are_a_twist_to_first_order() -> None:
    """exp(xi) T by its generator, for a small xi."""
    xi = np.array([2e-5, -1e-5, 3e-5, 1e-5, 2e-5, -3e-5])
    x, y, z = xi[3:]
    generator = np.zeros((4, 4))
    generator[:3, :3], generator[:3, 3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]], xi[:3]
    (found,) = local_coordinates([(np.eye(4) + generator) @ TRUTH], TRUTH)
    assert found == pytest.approx(xi, abs=1e-8)


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


def test_the_mean_does_not_depend_on_the_order() -> None:
    poses, covariances, _ = fleet(np.random.default_rng(3), 9)
    order = np.random.default_rng(4).permutation(9)
    one = robust_mean(poses, covariances)
    other = robust_mean([poses[i] for i in order], covariances[order])
    assert one.T_camera_lidar == pytest.approx(other.T_camera_lidar, abs=1e-9)


def test_scatter_beyond_what_is_stated_is_found_even_where_the_rig_changed() -> None:
    for extra in (0.0, 3.0):
        _, covariances, series = fleet(np.random.default_rng(1), 400, extra)
        series[200:] += 30.0 * SIGMAS
        found = np.sqrt(extra_scatter(series, covariances).variances) / SIGMAS
        assert found == pytest.approx(np.full(6, extra), rel=0.15, abs=0.5)


def test_a_change_is_found_where_it_happened() -> None:
    _, covariances, series = fleet(np.random.default_rng(2), 60)
    series[20:, 4] += np.radians(0.2)
    series[45:, 0] += 0.03
    assert change_points(series, covariances, MANY) == pytest.approx([20, 45], abs=1)


def test_noise_is_no_change() -> None:
    """At most as often as is stated, which 200 series can tell."""
    found = []
    for seed in range(200):
        _, covariances, series = fleet(np.random.default_rng(seed), 30)
        found.append(len(change_points(series, covariances, MANY)) > 0)
    assert np.mean(found) <= 3.0 * ALPHA + 0.01


@pytest.mark.parametrize("place", [0, 1, 12, 28, 29])
def test_one_that_lies_alone_is_neither_a_change_nor_a_drift(place: int) -> None:
    """Not even the last: a bad drive last night does not move the rig."""
    for seed in range(10):
        drives = series_of("nothing", 30, seed)
        off = np.array([0.2, 0.0, 0.0, 0.0, np.radians(0.8), 0.0])
        drives[place] = replace(drives[place], T_camera_lidar=pose_at(drives[place].T_camera_lidar, off))
        found = combine_drives(drives, Limits())
        assert (found.verdict, len(found.parts), found.drift) == ("fail", 1, None)
        (far,) = [drive.member.drive for drive in found.drives if drive.is_far]
        assert far == drives[place].drive
        (now,) = local_coordinates([found.T_camera_lidar], TRUTH)
        assert np.abs(now / SIGMAS).max() < 1.5


@pytest.mark.parametrize("share", [0.1, 0.15, 0.2])
def test_many_that_lie_alone_do_not_hide_one_another(share: float) -> None:
    for seed in range(5):
        drives = series_of("nothing", 40, seed)
        wrong = np.arange(1, 40, round(1.0 / share))
        for place in wrong:
            drives[place] = replace(drives[place], T_camera_lidar=make_pose((0.3, 0, 0), (1, 0, 0)) @ TRUTH)
        found = combine_drives(drives, Limits())
        far = [index for index, drive in enumerate(found.drives) if drive.verdict == "fail"]
        assert far == wrong.tolist()
        assert found.scatter[3:].max() < np.degrees(4.0 * SIGMAS[3:].max())


@pytest.mark.parametrize("count", [5, 6, 8, 12])
def test_few_drives_of_which_one_is_off_do_not_pass(count: int) -> None:
    """What few drives cannot tell from scatter is at least not called good, and named."""
    for seed in range(10):
        for places in ([count // 2], [count - 1], list(range(count // 2, count))):
            drives = series_of("nothing", count, seed)
            for place in places:
                T = drives[place].T_camera_lidar
                drives[place] = replace(
                    drives[place], T_camera_lidar=pose_at(T, np.array([0, 0, 0, 0, np.radians(0.8), 0]))
                )
            found = combine_drives(drives, Limits())
            assert found.verdict != "pass"
            assert found.reasons


def test_small_changes_add_up() -> None:
    drives = series_of("nothing", 40)
    for index, drive in enumerate(drives):
        turn = np.radians(0.25) * (index // 10)
        T = pose_at(drive.T_camera_lidar, np.array([0, 0, 0, 0, 0, turn]))
        drives[index] = replace(drive, T_camera_lidar=T)
    assert combine_drives(drives, Limits()).verdict == "fail"


def test_drives_are_in_the_order_of_stamps_that_compare_or_else_of_names() -> None:
    drives = series_of("change")
    by_name = [replace(drive, stamp=12.3, drive=f"drive_{i}") for i, drive in enumerate(drives)]
    found = combine_drives(by_name[::-1], Limits())
    assert (found.order, found.parts[1].first, found.verdict) == ("name", "drive_15", "fail")
    assert found.notes == ("drives have no stamps in seconds since 1970 that differ: ordered by name",)
    assert combine_drives(drives, Limits()).notes == ()


def test_a_drift_is_measured() -> None:
    times = np.linspace(0.0, 100.0, 40)
    rate = np.array([1e-4, 0.0, 0.0, 0.0, 2e-5, 0.0])
    off, alarms = [], 0
    for seed in range(40):
        _, covariances, series = fleet(np.random.default_rng(seed), 40)
        alarms += drift(times, series, covariances, MANY).is_significant
        found = drift(times, series + times[:, None] * rate, covariances, MANY)
        assert found.is_significant
        off.append((found.per_unit - rate) / np.sqrt(np.diag(found.covariance)))
    assert 0.8 < np.std(off) < 1.25
    assert alarms <= 3  # at a level of 1 %


def members(poses: list[Pose], covariances: np.ndarray) -> list[Member]:
    """Drives, one every half a day."""
    return [
        Member(f"{index:03d}", 1.7e9 + 43_200.0 * index, T, covariance, None)
        for index, (T, covariance) in enumerate(zip(poses, covariances, strict=True))
    ]


@pytest.mark.parametrize(("count", "extra"), [(3, 3.0), (5, 1.0), (8, 3.0), (20, 1.0), (60, 0.0)])
def test_intervals_hold_the_truth_and_nothing_is_seen_where_nothing_is(count: int, extra: float) -> None:
    """Intervals of 95 %, whether drives scatter as they say or by four times as much; 60 fleets, 360 axes each."""
    held, widths, errors, alarms = [], [], [], 0
    for seed in range(60):
        poses, covariances, _ = fleet(np.random.default_rng((count, seed)), count, extra)
        found = combine_drives(members(poses, covariances), Limits())
        (off,) = local_coordinates([found.T_camera_lidar], TRUTH)
        off_m_deg = np.concatenate([off[:3], np.degrees(off[3:])])
        held.append(np.abs(off_m_deg) <= found.parts[-1].half_widths)
        alarms += len(found.parts) > 1 or found.drift is not None
        alarms += any(drive.disagrees for drive in found.drives)
        widths.append(found.parts[-1].half_widths)
        errors.append(off_m_deg)
    assert np.mean(held) >= 0.90
    assert alarms <= 3
    # Nor are they wide for nothing: as wide as errors want them to be, but for what few drives do not tell.
    wanted = 1.96 * np.std(errors, axis=0)
    assert (np.median(widths, axis=0) < {3: 5.0, 5: 2.5}.get(count, 1.7) * wanted).all()


def series_of(kind: str, count: int = 24, seed: int = 8) -> list[Member]:
    """A fleet to which something happened."""
    rng = np.random.default_rng(seed)
    _, covariances, series = fleet(rng, count, 1.0)
    if kind == "change":
        series[15:, [1, 4]] += [0.08, np.radians(0.6)]
    if kind == "drift":
        series[:, 3] += np.radians(np.linspace(0.0, 0.8, count))
    if kind == "outlier":
        series[9, [0, 5]] += [0.2, np.radians(1.0)]
    if kind == "small change":
        series[15:, 4] += np.radians(0.22)
    return members([pose_at(TRUTH, each) for each in series], covariances)


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
    found = combine_drives(series_of(kind), Limits())
    assert (found.verdict, len(found.parts), found.drift is not None) == (verdict, num_parts, has_drift)
    disagreeing = [drive.member.drive for drive in found.drives if drive.disagrees]
    assert disagreeing == (["009"] if kind == "outlier" else [])
    if kind == "change":
        assert found.parts[1].first == "015"
        assert found.reasons[0].startswith("changed at 015 by ")
    (off,) = local_coordinates([found.T_camera_lidar], TRUTH)
    now = {
        "change": [0, 0.08, 0, 0, 0.6, 0],
        "drift": [0, 0, 0, 0.8, 0, 0],
        "small change": [0] * 4 + [0.22, 0],
    }
    off[3:] = np.degrees(off[3:])
    assert np.abs(off - now.get(kind, [0.0] * 6)).max() < 0.06


def test_the_order_is_that_of_time_and_else_nothing_depends_on_order() -> None:
    one = combine_drives(series_of("change"), Limits())
    shuffled = [series_of("change")[i] for i in np.random.default_rng(1).permutation(24)]
    other = combine_drives(shuffled, Limits())
    assert describe_fleet(one, {}) == describe_fleet(other, {})


def test_a_reference_is_judged() -> None:
    found = combine_drives(series_of("nothing"), Limits(), pose_at(TRUTH, np.array([0.1, 0, 0, 0, 0, 0])))
    assert found.verdict == "fail"
    assert [c.name for c in found.checks if c.verdict == "fail"] == [
        "from the reference: camera centre x",
        "from the reference: camera centre in all",
    ]
    (offset,) = [c.offset for c in found.checks if c.name == "from the reference: camera centre x"]
    assert offset == pytest.approx(10.0, abs=0.5)  # rho moves the centre the other way, here the reference's


def test_too_few_drives_decide_nothing() -> None:
    found = combine_drives(series_of("nothing")[:2], Limits())
    assert found.verdict == "inconclusive"
    mostly_out = [replace(m, left_out="not trusted") for m in series_of("nothing")[:14]]
    found = combine_drives([*mostly_out, *series_of("nothing")[14:]], Limits())
    assert (found.verdict, found.reasons) == ("inconclusive", ("10 of 24 drives can be used, needed 50%",))
    with pytest.raises(
        CalibrationError, match="found no drive of 14 that can be used, needed 3; the first, 000"
    ):
        combine_drives(mostly_out, Limits())


def line(member: Member, **changes: object) -> dict:
    """A line of a batch's summary."""
    assert member.T_camera_lidar is not None
    assert member.covariance is not None
    found = {"drive": f"drives/{member.drive}", "status": "trusted", "exit_code": 0, "reasons": []}
    found |= {"stamp": member.stamp, "T_camera_lidar": member.T_camera_lidar.tolist()}
    found |= {"covariance": member.covariance.tolist(), "mutual_information_nats": 1.5}
    found |= {"camera": "a", "result": f"{member.drive}/calibration.yaml"}
    return found | changes


def write_summary(folder: Path, lines: list[dict]) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "summary.jsonl").write_text("".join(json.dumps(each) + "\n" for each in lines))
    return folder


def run(*arguments: object) -> Result:
    return CliRunner().invoke(semcal, ["fleet", *map(str, arguments)])


def test_the_command(tmp_path: Path) -> None:
    lines = [line(member) for member in series_of("change")]
    lines[3] |= {"status": "not_trusted", "reasons": ["overlap 3 %"], "exit_code": 3}
    lines[4] |= {"status": "failed", "T_camera_lidar": None, "covariance": None, "exit_code": 1}
    batch = write_summary(tmp_path / "batch", lines)
    out = tmp_path / "fleet.yaml"
    extra = ["--report", tmp_path / "f.html", "--plot", tmp_path / "f.svg", "--junit", tmp_path / "f.xml"]
    found = run(batch, "-o", out, *extra)
    assert found.exit_code == 3, found.output
    assert "drives/003: left out: not trusted; overlap 3 %" in found.stderr
    assert found.stderr.endswith("fail\n")
    document = read_document(out)
    assert document["status"] == "fail"
    assert [d["drive"] for d in document["drives"] if d["status"] == "left_out"] == [
        "drives/003",
        "drives/004",
    ]
    assert read_transform(out) == pytest.approx(np.array(document["T_camera_lidar"]))
    page = (tmp_path / "f.html").read_text()
    assert "The rig does not hold" in page
    assert "changed at drives/015" in page
    assert "://" not in page
    first = {name: (tmp_path / name).read_bytes() for name in ("fleet.yaml", "f.html", "f.svg", "f.xml")}
    assert run(batch, "-o", out, *extra).exit_code == 3
    assert first == {name: (tmp_path / name).read_bytes() for name in first}


def test_the_exit_codes(tmp_path: Path) -> None:
    steady = [line(member) for member in series_of("nothing")]
    assert run(write_summary(tmp_path / "a", steady)).exit_code == 0
    xml = tmp_path / "f.xml"
    assert run(write_summary(tmp_path / "b", steady[:2]), "--junit", xml).exit_code == 4
    *_, skipped = [case for case in ElementTree.parse(xml).getroot() if case.find("skipped") is not None]
    assert skipped.get("name") == "all together"
    # Drives of two batches, and limits below what drives scatter by.
    rest = write_summary(tmp_path / "c", steady[2:])
    assert run(tmp_path / "b", rest).exit_code == 0
    assert run(tmp_path / "b", rest, "--max-rotation-deg", "0.06").exit_code == 4
    assert run(tmp_path / "b", rest, "--max-rotation-deg", "1e-4").exit_code == 3


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"status": "pass"}, "line 2: status: found 'pass', of verify"),
        ({"status": "fine"}, "line 2: status: found 'fine', needed"),
        (
            {"T_camera_lidar": [[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]},
            "line 2: T_camera_lidar",
        ),
        (
            {"covariance": np.diag([1, 1, 1, 1, 1, -1.0]).tolist()},
            "line 2: covariance: found standard errors of 0 to",
        ),
        ({"covariance": np.zeros((6, 6)).tolist()}, "line 2: covariance: found standard errors of 0 to"),
        ({"covariance": None}, None),
        ({"T_camera_lidar": None}, "line 2: T_camera_lidar: found nothing"),
        ({"extra": 1}, "line 2: unknown key 'extra'"),
        ({"result": "000/calibration.yaml"}, "000: found twice"),
        ({"drive": "drives/000"}, None),
        ({"stamp": 1e300}, "line 2: stamp"),
    ],
)
def test_wrong_lines_are_named(changes: dict, complaint: str | None, tmp_path: Path) -> None:
    lines = [line(member) for member in series_of("nothing")[:5]]
    lines[1] |= changes
    found = run(write_summary(tmp_path / "batch", lines))
    if complaint is None:
        assert found.exit_code == 0
        assert ("drives/001: left out: nothing is known of its error" in found.stderr) == (
            "covariance" in changes
        )
    else:
        assert isinstance(found.exception, InputError)
        assert complaint in str(found.exception)


def test_what_is_no_result_is_named(tmp_path: Path) -> None:
    for content, complaint in (
        ("{\n", "summary.jsonl: line 1: "),
        ("", "found no drives"),
        ("[]\n", "line 1: "),
    ):
        (tmp_path / "summary.jsonl").write_text(content)
        assert complaint in str(run(tmp_path).exception)
    assert "no such file" in str(run(tmp_path / "none").exception)
    write_summary(tmp_path, [line(member) for member in series_of("nothing")])
    for option in ("-o", "--report", "--plot"):
        assert "found suffix '.txt'" in str(run(tmp_path, option, tmp_path / "out.txt").exception)
    assert "reads or writes" in str(run(tmp_path, "--junit", tmp_path / "summary.jsonl").exception)


def test_one_stamp_that_is_missing_is_no_reason_to_pass() -> None:
    drives = series_of("nothing")
    drives[5] = replace(drives[5], stamp=None)
    found = combine_drives(drives, Limits())
    assert found.verdict == "inconclusive"
    assert found.reasons == (
        "1 of 24 drives have no stamp in seconds since 1970, needed one of each: the order of time is not known",
    )


def test_copies_count_once(tmp_path: Path) -> None:
    lines = [line(member) for member in series_of("nothing")[:5]]
    one = write_summary(tmp_path / "one", lines)
    two = write_summary(tmp_path / "two", lines)
    assert "found the same result to the last bit" in str(run(one, two).exception)


@pytest.mark.parametrize(
    ("sigma", "complaint"),
    [
        (1e-160, "found standard errors of 1e-160 to 1e-160 m, needed 1e-05 to 100"),
        (1e153, "of 1e\\+153 to 1e\\+153 m"),
    ],
)
def test_standard_errors_that_no_calibration_has(sigma: float, complaint: str, tmp_path: Path) -> None:
    lines = [line(member) for member in series_of("nothing")[:5]]
    lines[3]["covariance"] = (sigma**2 * np.eye(6)).tolist()
    assert re.search(complaint, str(run(write_summary(tmp_path / "batch", lines)).exception))


def test_a_result_is_checked_and_compared_as_a_calibration_is(tmp_path: Path) -> None:
    out = tmp_path / "fleet.json"
    run(write_summary(tmp_path / "batch", [line(member) for member in series_of("nothing")]), "-o", out)
    compared = CliRunner().invoke(semcal, ["compare", str(out), str(out)])
    assert "not known" not in compared.output
    document = json.loads(out.read_text())
    for key, value in (
        ("translation_m", [0, 0, 0]),
        ("quaternion_xyzw", "junk"),
        ("T_lidar_camera", np.eye(4).tolist()),
    ):
        out.write_text(json.dumps(document | {key: value}))
        with pytest.raises(InputError, match=key):
            read_transform(out)


def test_a_failure_to_write_leaves_the_earlier_result(tmp_path: Path) -> None:
    batch = write_summary(tmp_path / "batch", [line(member) for member in series_of("nothing")])
    out = tmp_path / "fleet.yaml"
    out.write_text("an earlier result")
    assert isinstance(run(batch, "-o", out, "--junit", "/dev/full").exception, InputError)
    assert out.read_text() == "an earlier result"


def test_names_may_hold_anything(tmp_path: Path) -> None:
    lines = [line(member) for member in series_of("outlier")]
    lines[9]["drive"] = '<b>"&\x01\x1b[31m\n' + "9" * 5000
    xml = tmp_path / "f.xml"
    found = run(write_summary(tmp_path / "batch", lines), "--junit", xml, "--report", tmp_path / "f.html")
    assert found.exit_code == 3
    assert "\x1b" not in found.stderr
    assert "<b>" not in (tmp_path / "f.html").read_text()
    suite = ElementTree.parse(xml).getroot()
    failed = [case.get("name", "") for case in suite if case.find("failure") is not None]
    assert failed[1:] == ["all together"]
    assert '<b>"&??[31m\n999' in failed[0]
    lines[9]["drive"] = "a\x00b"
    assert "line 10: drive: found" in str(run(write_summary(tmp_path / "batch", lines)).exception)
    (tmp_path / "batch/summary.jsonl").write_text("\n")
    assert "found no drives" in str(run(tmp_path / "batch").exception)


def test_names_that_differ_in_zeros_keep_their_order() -> None:
    drives = [
        replace(drive, stamp=None, drive="0" * i + "1") for i, drive in enumerate(series_of("nothing")[:6])
    ]
    one, other = combine_drives(drives, Limits()), combine_drives(drives[::-1], Limits())
    assert one.T_camera_lidar.tolist() == other.T_camera_lidar.tolist()


def test_a_line_is_what_a_batch_writes() -> None:
    assert set(_Line.model_fields) == {field.name for field in fields(Outcome)}
