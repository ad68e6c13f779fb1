"""`semcal fleet` on a batch's summary: its exit codes, its files, and lines that are wrong."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from click.testing import Result
from commands import invoke
from conftest import make_pose
from fleets import line, series_of, write_summary

from semcal_cli.documentation import entry_address
from semcal_cli.errors import InputError
from semcal_cli.files.documents import read_document
from semcal_cli.formats import read_transform


def run(*arguments: object) -> Result:
    return invoke("fleet", *arguments)


def test_the_command(tmp_path: Path) -> None:
    lines = [line(drive) for drive in series_of("change")]
    lines[3] |= {"status": "not_trusted", "reasons": ["overlap 3 %"], "topics": ["overlap"], "exit_code": 3}
    lines[4] |= {"status": "failed", "T_camera_lidar": None, "covariance": None, "exit_code": 1}
    batch = write_summary(tmp_path / "batch", lines)
    out = tmp_path / "fleet.yaml"
    extra = ["--report", tmp_path / "f.html", "--plot", tmp_path / "f.svg", "--junit", tmp_path / "f.xml"]
    result = run(batch, "-o", out, *extra)
    assert result.exit_code == 3, result.output
    assert "left out         drives/003: not trusted; overlap 3 %" in result.stderr
    assert result.stderr.endswith("verdict          fail: the rig changed\n")
    assert max(map(len, result.stderr.splitlines())) <= 80 + len(str(tmp_path))
    document = read_document(out)
    assert document["status"] == "fail"
    left_out = [drive["drive"] for drive in document["drives"] if drive["status"] == "left_out"]
    assert left_out == ["drives/003", "drives/004"]
    assert read_transform(out) == pytest.approx(np.array(document["T_camera_lidar"]))
    page = (tmp_path / "f.html").read_text()
    assert "<h1>The rig changed</h1>" in page
    assert "changed between drives/014 and drives/015: " in page
    link = f'<a href="{entry_address("overlap")}">why this comes up</a>'
    assert f"not trusted; overlap 3 % ({link})</td>" in page
    assert "://" not in page.replace(link, "")
    first = {name: (tmp_path / name).read_bytes() for name in ("fleet.yaml", "f.html", "f.svg", "f.xml")}
    assert run(batch, "-o", out, *extra).exit_code == 3
    assert first == {name: (tmp_path / name).read_bytes() for name in first}


def test_drives_of_two_rigs_are_grouped_and_get_no_pose(tmp_path: Path) -> None:
    lines = [line(drive) for drive in series_of("nothing", 8)]
    for entry in lines[::2]:
        T = np.array(entry["T_camera_lidar"]) @ make_pose((0.0, 0.0, 1.5), (0.6, 0.0, 0.0))
        entry["T_camera_lidar"] = T.tolist()
    result = run(write_summary(tmp_path / "batch", lines), "-o", tmp_path / "fleet.yaml")
    assert result.exit_code != 0
    first = result.stderr.splitlines()[0]
    assert first == "agreed pose      none: 8 trusted drives fall into 2 groups that differ"
    assert "group 2          4 drives: " in result.stderr
    assert "T_camera_lidar" not in result.stderr


def test_the_exit_codes(tmp_path: Path) -> None:
    steady = [line(drive) for drive in series_of("nothing")]
    assert run(write_summary(tmp_path / "a", steady)).exit_code == 0
    xml = tmp_path / "f.xml"
    assert run(write_summary(tmp_path / "b", steady[:2]), "--junit", xml).exit_code == 4
    *_, undecided = [case for case in ElementTree.parse(xml).getroot() if case.find("error") is not None]
    assert undecided.get("name") == "all together"
    assert run(tmp_path / "b", "--inconclusive", "skip").exit_code == 0
    # Drives of two batches, and limits below what drives scatter by.
    rest = write_summary(tmp_path / "c", steady[2:])
    assert run(tmp_path / "b", rest).exit_code == 0
    assert run(tmp_path / "b", rest, "--max-rotation-deg", "0.06").exit_code == 4
    assert run(tmp_path / "b", rest, "--max-rotation-deg", "1e-4").exit_code == 3


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"status": "pass"}, "line 2: status: found 'pass' from verify"),
        ({"status": "fine"}, "line 2: status: found 'fine', expected"),
        (
            {"T_camera_lidar": [[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]},
            "line 2: T_camera_lidar",
        ),
        (
            {"covariance": np.diag([1, 1, 1, 1, 1, -1.0]).tolist()},
            "line 2: covariance: found a variance of -1, needed at least 0",
        ),
        ({"covariance": np.zeros((6, 6)).tolist()}, "line 2: covariance: found standard errors of 0 to"),
        ({"covariance": None}, None),
        ({"T_camera_lidar": None}, "line 2: T_camera_lidar: found none"),
        ({"camera": ""}, "line 2: camera: found '', expected text that matches \\S"),
        ({"extra": 1}, "line 2: unknown key 'extra'"),
        ({"drive": "a\x00b"}, "line 2: drive: found"),
        ({"drive": "drives/000"}, None),
        ({"stamp": 1e300}, "line 2: stamp"),
        (
            {"covariance": (1e-160**2 * np.eye(6)).tolist()},
            "line 2: covariance: found standard errors of 1e-160 to 1e-160 m, needed 1e-05 to 100",
        ),
        ({"covariance": (1e19**2 * np.eye(6)).tolist()}, "found standard errors of 1e+19 to 1e+19 m"),
        (
            line(series_of("nothing")[0], drive="copy", result=None),
            "found results that agree to the last bit",
        ),
    ],
)
def test_wrong_lines_are_named(changes: dict, complaint: str | None, tmp_path: Path) -> None:
    lines = [line(drive) for drive in series_of("nothing")[:5]]
    lines[1] |= changes
    result = run(write_summary(tmp_path / "batch", lines))
    if complaint is None:
        assert result.exit_code == 0
        assert ("drives/001: its error is unknown" in result.stderr) == ("covariance" in changes)
    else:
        assert isinstance(result.exception, InputError)
        assert complaint in str(result.exception)


def test_what_is_no_result_is_named(tmp_path: Path) -> None:
    for content, complaint in (
        ("{\n", "summary.jsonl: line 1: "),
        ("", "found no drives"),
        ("\n", "found no drives"),
        ("[]\n", "line 1: "),
    ):
        (tmp_path / "summary.jsonl").write_text(content)
        assert complaint in str(run(tmp_path).exception)
    assert "no such file" in str(run(tmp_path / "none").exception)
    write_summary(tmp_path, [line(drive) for drive in series_of("nothing")])
    for option in ("-o", "--report", "--plot"):
        assert "found suffix '.txt'" in str(run(tmp_path, option, tmp_path / "out.txt").exception)
    assert "reads or writes" in str(run(tmp_path, "--junit", tmp_path / "summary.jsonl").exception)


def test_what_is_worst_stands_first(tmp_path: Path) -> None:
    """In the page's tables: drives clearly beyond the limits, then others by time; checks that fail, then the rest."""
    lines = [line(drive) for drive in series_of("outlier")]
    lines[9]["drive"] = "drives/zz"
    page = tmp_path / "f.html"
    run(write_summary(tmp_path / "batch", lines), "--report", page, "--max-rotation-deg", "0.015")
    rows = re.findall(
        r'<tr class="(\w+)">\s*<td class="verdict-cell">([^<]*)</td><td class="drive">([^<]*)<',
        page.read_text(),
    )
    drives = [(kind, drive) for kind, _, drive in rows if drive.startswith("drives/")]
    assert drives[0] == ("beyond", "drives/zz")
    assert {kind for kind, _ in drives} == {"beyond", "disagrees", "agrees"}
    assert drives == sorted(drives, key=lambda row: (["beyond", "disagrees", "agrees"].index(row[0]), row[1]))
    checks = [kind for kind, _, drive in rows if not drive.startswith("drives/")]
    assert set(checks) >= {"inconclusive", "pass"}
    assert checks == sorted(checks, key=["fail", "inconclusive", "pass"].index)


def test_a_result_is_read_as_a_calibration_is(tmp_path: Path) -> None:
    """And is the same on standard output; a run that fails leaves the earlier one."""
    batch = write_summary(tmp_path / "batch", [line(drive) for drive in series_of("nothing")])
    out = tmp_path / "fleet.json"
    beside = run(batch, "--json", "-o", out)
    document = json.loads(out.read_text())
    assert json.loads(beside.stdout) == document
    assert json.loads(run(batch, "--json").stdout)["status"] == document["status"] == "pass"
    assert isinstance(run(batch, "-o", out, "--junit", "/dev/full").exception, InputError)
    assert json.loads(out.read_text()) == document
    compared = invoke("compare", out, out)
    assert "not known" not in compared.output
    changes = {"translation_m": [0, 0, 0], "quaternion_xyzw": "junk", "T_lidar_camera": np.eye(4).tolist()}
    for key, value in changes.items():
        out.write_text(json.dumps(document | {key: value}))
        with pytest.raises(InputError, match=key):
            read_transform(out)


def test_names_may_hold_anything(tmp_path: Path) -> None:
    lines = [line(drive) for drive in series_of("outlier")]
    lines[9]["drive"] = '<b>"&\x01\x1b[31m\n' + "9" * 5000
    xml, page = tmp_path / "f.xml", tmp_path / "f.html"
    result = run(write_summary(tmp_path / "batch", lines), "--junit", xml, "--report", page)
    assert result.exit_code == 3
    assert "\x1b" not in result.stderr
    assert "<b>" not in page.read_text()
    suite = ElementTree.parse(xml).getroot()
    failed = [case.get("name", "") for case in suite if case.find("failure") is not None]
    assert failed[1:] == ["all together"]
    assert '<b>"&??[31m\n999' in failed[0]


def test_a_failed_drive_that_is_given_twice_is_refused(tmp_path: Path) -> None:
    failed = line(series_of("nothing", 1)[0])
    failed |= {"status": "failed", "T_camera_lidar": None, "covariance": None, "reasons": ["x"]}
    batch = str(write_summary(tmp_path / "batch", [failed]))
    done = invoke("fleet", batch, batch)
    assert str(done.exception).endswith("found the same failed drive twice, expected each drive once")
