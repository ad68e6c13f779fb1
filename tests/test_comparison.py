"""Numbers beside what is allowed: with digits that tell them apart, and judged by what is known of them."""

import csv
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from commands import invoke

from semcal_cli.errors import format_against_limit
from semcal_cli.files.documents import document_text
from semcal_cli.formats import read_transform, write_transform
from semcal_cli.formats.format import FormatOptions
from semcal_cli.geometry.poses import PoseError
from semcal_cli.geometry.twists import apply_twist
from semcal_cli.pipeline.comparison import Axis, Comparison
from semcal_cli.pipeline.verdict import Verdict
from semcal_cli.result.calibration_document import pose_forms, read_calibration
from semcal_cli.result.pixel_errors import RANGES_M


@pytest.mark.parametrize(
    ("found", "needed", "digits", "unit", "expected"),
    [
        (0.6512, 0.65, 0, "%", ("65.1%", "65%")),
        (2.987, 3.0, 1, "", ("2.99", "3")),
        (1.4, 3.0, 1, "", ("1.4", "3")),
        (0.30004, 0.3, 3, "", ("0.30004", "0.3")),
        (3.0, 3.0, 1, "", ("3.0", "3")),
        (-1e-9, 0.3, 3, "", ("0.000", "0.3")),
        (float("inf"), 0.65, 0, "%", ("inf%", "65%")),
    ],
)
def test_two_numbers_are_written_so_that_they_differ(
    found: float, needed: float, digits: int, unit: str, expected: tuple[str, str]
) -> None:
    assert format_against_limit(found, needed, digits, unit) == expected


@pytest.mark.parametrize(
    ("half_a", "half_b", "off", "verdict"),
    [
        (0.2, 0.2, 0.308, "inconclusive"),
        (0.2, None, 0.308, "inconclusive"),
        (None, None, 0.308, "fail"),
        (0.003, 0.003, 0.308, "fail"),
        (0.2, 0.2, 0.29, "pass"),
    ],
)
def test_a_difference_within_what_is_known_of_its_limit_is_undecided(
    half_a: float | None, half_b: float | None, off: float, verdict: Verdict
) -> None:
    offsets_deg = (off, 0.0, 0.0)
    axes = tuple(
        Axis(f"rotation {axis}", "deg", offset_deg, half_a, half_b)
        for axis, offset_deg in zip("xyz", offsets_deg, strict=True)
    )
    offsets_rad = tuple(np.radians(offsets_deg).tolist())
    comparison = Comparison(PoseError(offsets_rad[0], 0.0, offsets_rad, (0.0, 0.0, 0.0)), axes)
    assert comparison.verdict(off, 0.3, "deg") == verdict


@pytest.mark.parametrize(
    "command",
    [
        ["compare", "{drive}", "{bare}"],
        ["overlay", "{drive}", "{bare}", "--max-frames", "1", "-o", "{out}", "--against", "{drive}"],
        ["report", "{drive}", "{bare}", "-o", "{out}.html"],
        ["export", "ply", "{drive}", "{bare}", "--max-frames", "1", "-o", "{out}"],
    ],
    ids=lambda command: command[0],
)
def test_the_direction_of_a_bare_matrix_can_be_stated(
    command: list[str], street: Path, tmp_path: Path
) -> None:
    """Also beside a file that states its own."""
    T = read_transform(street)
    np.savetxt(tmp_path / "bare.txt", np.linalg.inv(T))
    words = [word.format(drive=street, bare=tmp_path / "bare.txt", out=tmp_path / "out") for word in command]
    refused = invoke(*words)
    assert "add --reference-direction lidar-to-camera" in str(refused.exception)
    done = invoke(*words, "--reference-direction", "camera-to-lidar")
    assert done.exit_code == 0, done.output
    if command[0] == "compare":
        wrong = invoke(*words, "--reference-direction", "lidar-to-camera")
        assert (wrong.exit_code, "verdict          fail: rotation" in wrong.output) == (3, True)


def test_several_transforms_are_compared_with_the_first(street: Path, tmp_path: Path) -> None:
    T = read_transform(street)
    files = []
    for shift_m in (0.0, 0.01, 0.5):
        moved = T.copy()
        moved[0, 3] += shift_m
        files.append(tmp_path / f"{shift_m}.yaml")
        write_transform(moved, files[-1], "semcal")
    table, plot = tmp_path / "t.csv", tmp_path / "t.svg"
    result = invoke("compare", street, *files, "--csv", table, "--plot", plot)
    assert result.exit_code == 3, result.output
    with table.open() as file:
        rows = list(csv.DictReader(file))
    assert [row["file"] for row in rows] == list(map(str, files))
    np.testing.assert_allclose([float(row["camera_center_cm"]) for row in rows], [0.0, 1.0, 50.0], atol=1e-4)
    assert [row["verdict"] for row in rows] == ["pass", "pass", "fail"]
    assert all(name in result.output for name in ("0.01.yaml", "50.00"))
    note = (
        "the difference does not tell which of them is right; `semcal verify DRIVE FILE` does verdict fail: "
    )
    assert note in " ".join(result.stdout.split())
    assert "which of them is right" not in invoke("compare", street, files[0]).stdout
    assert plot.read_text().startswith("<?xml")
    assert invoke("compare", street, files[0], "--csv", files[0]).exit_code == 1
    for option, file in (("--csv", table), ("--plot", plot)):
        before = file.read_bytes()
        kept = invoke("compare", street, files[0], option, file)
        assert str(kept.exception) == f"{file}: found a file; choose another name, or add --force"
        assert file.read_bytes() == before
        assert invoke("compare", street, files[0], option, file, "--force").exit_code == 0
        assert file.read_bytes() != before
    assert invoke("compare", street, *files, "--plot", tmp_path / "t.pdf").exit_code == 1


def test_a_difference_is_shown_in_the_image(made: Path, street: Path, tmp_path: Path) -> None:
    """Beside what the intervals allow, if both are known and believed."""
    record, moved = read_calibration(made / "c.yaml"), tmp_path / "moved.yaml"
    assert record.uncertainty is not None
    turned = pose_forms(apply_twist(record.pose, np.array([0.0, 0.0, 0.0, 0.0, 0.004, 0.0])))
    moved.write_text(document_text(record.model_dump() | turned, "yaml"))
    differences = json.loads(invoke("compare", made / "c.yaml", moved, "--json").stdout)["in_image"]
    assert [difference["range_m"] for difference in differences] == [*RANGES_M]
    for difference, of_one in zip(differences, record.uncertainty.in_image, strict=True):
        # A turn moves points at all ranges alike.
        assert difference["ahead_px"] == pytest.approx(0.004 * record.used_camera.K[0][0], rel=1e-3)
        assert difference["ahead_px"] < difference["worst_px"]
        assert difference["allowed_ahead_px"] == pytest.approx(math.sqrt(2.0) * (of_one.ahead_px or 0.0))
        assert difference["allowed_worst_px"] <= math.sqrt(2.0) * of_one.worst_px * (1.0 + 1e-9)
    plot = tmp_path / "map.svg"
    text = invoke("compare", made / "c.yaml", moved, "--plot", plot).stdout
    assert re.search(r"\n10 m away +[\d.]+ px +[\d.]+ px +[\d.]+ px and [\d.]+ px\n", text)
    assert plot.read_text().startswith("<?xml")
    wider = moved.read_text().replace(f"width: {record.used_camera.width}\n", "width: 4000\n")
    (tmp_path / "wider.yaml").write_text(wider)
    unlike = invoke("compare", made / "c.yaml", tmp_path / "wider.yaml", "--plot", tmp_path / "bars.svg")
    assert "m away" not in unlike.stdout
    width, height = record.used_camera.size
    said = f"the images are of {width} x {height} and 4000 x {height} pixels, so the difference in the image is unknown"
    assert f"{said}; --plot draws bars" in " ".join(unlike.stderr.split())
    moved.write_text(moved.read_text().replace("status: trusted", "status: not_trusted"))
    assert re.search(r"\n10 m away +[\d.]+ px +[\d.]+ px\n", invoke("compare", made / "c.yaml", moved).stdout)


def test_a_bare_transform_is_seen_by_the_camera_of_the_other_file(street: Path, tmp_path: Path) -> None:
    """Two of them have none, and their plot is that of several files."""
    for name in ("a.yaml", "b.yaml"):
        write_transform(read_transform(street), tmp_path / name, "semcal")
    assert "10 m away" in invoke("compare", tmp_path / "a.yaml", street).stdout
    bare = invoke("compare", tmp_path / "a.yaml", tmp_path / "b.yaml", "--plot", tmp_path / "bars.png")
    assert (bare.exit_code, "m away" in bare.stdout) == (0, False)
    assert (tmp_path / "bars.png").stat().st_size > 0


def test_the_camera_of_a_file_with_several_is_named(street: Path, tmp_path: Path) -> None:
    """P2 of KITTI is 6 cm to the right of camera 0, which the file's transform belongs to."""
    T = read_transform(street)
    calib, second, other = (tmp_path / name for name in ("calib.txt", "second.yaml", "other.yaml"))
    write_transform(T, calib, "kitti-object", FormatOptions(camera="P0"))
    calib.write_text("P2: 700 0 600 42 0 700 200 0 0 0 1 0\n" + calib.read_text())
    shift = np.eye(4)
    shift[0, 3] = 0.06
    write_transform(shift @ T, second, "semcal")
    compared = invoke("compare", calib, second)
    assert "fail: camera centre 6.0 cm" in compared.output
    assert compared.stderr == f"{calib}: read as the transform of camera 0; --camera P2 reads another\n"
    # The name counts for the file that has several cameras, whichever of the two that is.
    for files in ((calib, second), (second, calib)):
        done = invoke("compare", *files, "--camera", "P2")
        assert done.exit_code == 0, done.output
    write_transform(T, other, "semcal")
    refused = invoke("compare", calib, other, "--camera", "left")
    assert "takes this option" not in str(refused.exception)
    needless = invoke("compare", second, other, "--camera", "P2")
    assert needless.exit_code == 2
    assert "found no file that may hold several cameras" in needless.output
    assert str(refused.exception) == "--camera: found 'left', expected one of: P0, P1, P2, P3"
