"""What `report`, `overlay` and `inspect` show of a rig."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import Result
from commands import invoke
from conftest import NAMES, edited, make_pose

from semcal_cli.documentation import ADDRESS, entry_address
from semcal_cli.errors import InputError
from semcal_cli.files.image_files import read_image
from semcal_cli.geometry.poses import inverse
from semcal_cli.many.rig.rig_calibration import RigCalibration
from semcal_cli.many.rig.rig_document import read_rig
from semcal_cli.many.rig.rig_page import rig_page_html, rig_verdict
from semcal_cli.many.rig.rig_result import read_rig_files
from semcal_cli.report.words import NOT_BELIEVED
from semcal_cli.result.calibration_document import read_calibration

Results = tuple[Result, Path]
CAPTION_PX = 20


def copy_results(results: Results, out: Path) -> Path:
    """Copy the results of a rig, to be broken."""
    return Path(shutil.copytree(results[1], out))


def test_the_page_of_a_rig(rig: Path, rig_results: Results, tmp_path: Path) -> None:
    """The same bytes from the folder, from its document, and beside the calibration."""
    pages = []
    for rig_path, result in ((rig, rig_results[1]), (rig.parent, rig_results[1] / "rig_calibration.yaml")):
        pages.append(tmp_path / f"{len(pages)}.html")
        ending = invoke("report", rig_path, result, "-o", pages[-1])
        assert ending.exit_code == 0, ending.output
    first, second = (page.read_bytes() for page in pages)
    assert first == second == (rig.parents[1] / "rig.html").read_bytes()
    assert len(first) < 5e6
    page = first.decode()
    assert "://" not in page.replace(f'<a href="{ADDRESS}/', "")
    assert page.count("data:image/webp") == len(NAMES)
    # Each pair and each camera has its matrix to copy, and the pair its direction in words.
    matrices = {
        name: np.array(text.split(), float).reshape(4, 4)
        for name, text in re.findall(r'<pre id="((?:camera-T|pair)-\d)">([^<]*)</pre>', page)
    }
    a, b = (read_calibration(rig_results[1] / f"{name}.yaml").pose for name in NAMES)
    assert matrices["camera-T-1"] == pytest.approx(a, abs=1e-8)
    assert matrices["pair-1"] == pytest.approx(a @ inverse(b), abs=1e-8)
    assert "p_camera_0 = T_camera_0_camera_1 p_camera_1: from camera_1 to camera_0" in page
    assert re.search(r"mm and [\d.]+ degrees from T_camera_lidar of both drives, ", page)
    cloud = json.loads(re.search(r'id="cloud-data">(.*?)</script>', page)[1])  # type: ignore[index]
    assert [camera["name"] for camera in cloud["cameras"]] == list(NAMES)
    assert cloud["cameras"][0]["camera_center"] == pytest.approx((-a[:3, :3].T @ a[:3, 3]).tolist())


def test_the_worst_camera_stands_first(rig: Path, rig_results: Results) -> None:
    calibration, drives, _ = read_rig_files(read_rig(rig), rig_results[1])
    reasons = {"reasons": ("few < many",), "topics": ("overlap",)}
    doubted = calibration.cameras["camera_1"].model_copy(update={"status": "not_trusted", **reasons})
    sound = {"status": "trusted", "reasons": (), "topics": ()}
    trusted = calibration.cameras["camera_0"].model_copy(update=sound)
    pairs = tuple(replace(pair, is_doubted=True) for pair in calibration.pairs)
    worse = RigCalibration({"camera_0": trusted, "camera_1": doubted}, {}, pairs, 3)
    verdict = rig_verdict(worse)
    assert (verdict.status, verdict.title) == ("not_trusted", "1 of 2 cameras is not trusted")
    assert verdict.sentence == (
        "These can be used: camera_0. Do not use these, for the reasons below: camera_1."
    )
    assert verdict.reasons == (("camera_1: few < many", entry_address("overlap")),)
    page = rig_page_html(worse, drives, ("rig", "result"))
    link = f'few &lt; many (<a href="{entry_address("overlap")}">why this comes up</a>)</li>'
    assert f"<li>camera_1: {link}" in page
    assert f"<li>{link}" in page
    assert re.findall(r"</i>(camera_\d): <span", page) == ["camera_1", "camera_0"]
    assert page.count(NOT_BELIEVED) == page.count("95 % interval: x y z") == 1
    failed = RigCalibration({"camera_0": trusted}, {"camera_1": "no <labels>"}, (), 3)
    verdict = rig_verdict(failed)
    assert (verdict.status, verdict.title) == ("fail", "1 of 2 cameras failed")
    page = rig_page_html(failed, drives, ("rig", "result"))
    assert page.index("no &lt;labels&gt;") < page.index("</i>camera_0: <span")
    assert "There is no transform." in page
    good = RigCalibration({"camera_0": trusted, "camera_1": trusted}, {}, calibration.pairs, 3)
    assert rig_verdict(good).sentence == "Both cameras are trusted."
    assert rig_verdict(good).figures.startswith("each is known to +- ")


def test_each_camera_has_a_folder_of_images(rig: Path, rig_results: Results, tmp_path: Path) -> None:
    ending = invoke(
        "overlay", rig, rig_results[1], "-o", tmp_path / "out", "--by", "depth", "--max-frames", "2"
    )
    assert ending.exit_code == 0, ending.output
    written = sorted(path.relative_to(tmp_path / "out").as_posix() for path in tmp_path.rglob("*.png"))
    assert written == [f"{name}/00000{frame}.png" for name in NAMES for frame in (0, 2)]
    # The image is that of the camera alone, below its caption.
    alone = tmp_path / "alone"
    result = rig_results[1] / "camera_1.yaml"
    invoke("overlay", rig.parent / "camera_1", result, "-o", alone, "--by", "depth", "--max-frames", "2")
    images = [read_image(folder / "000002.png") for folder in (tmp_path / "out/camera_1", alone)]
    assert np.array_equal(images[0][CAPTION_PX:], images[1][CAPTION_PX:])
    assert ending.stderr.splitlines()[-1] == str(tmp_path / "out/camera_1/000002.png")


def test_what_is_suspicious_with_any_camera_stands_first(rig: Path, tmp_path: Path) -> None:
    out = Path(shutil.copytree(rig.parent, tmp_path / "rig"))
    with edited(out / "camera_1") as drive:
        drive["camera"]["K"][0][2] += 400.0
    lines = invoke("inspect", out).stdout.splitlines()
    assert lines[0].startswith("warning     camera_1: ")
    assert [line for line in lines if line.startswith("[")] == [f"[{name}]" for name in NAMES]
    first = lines.index("[camera_0]")
    assert not any(line.startswith("suspicious") for line in lines[first:])
    document = json.loads(invoke("inspect", out, "--json").stdout)
    assert list(document) == list(NAMES)
    assert document["camera_1"]["suspicions"]
    assert document["camera_0"] == json.loads(invoke("inspect", out / "camera_0", "--json").stdout)


def test_results_that_do_not_belong_to_the_rig(rig: Path, rig_results: Results, tmp_path: Path) -> None:
    out = copy_results(rig_results, tmp_path / "out")
    page, file = tmp_path / "p.html", out / "rig_calibration.yaml"
    document = yaml.safe_load(file.read_text())

    def complaint(result: Path) -> str:
        ending = invoke("report", rig, result, "-o", page)
        assert isinstance(ending.exception, InputError), ending.output
        return str(ending.exception)

    assert complaint(out / "camera_0.yaml") == (
        f"{out}/camera_0.yaml: found no key semcal_rig_calibration, expected the rig_calibration.yaml that "
        f"`semcal calibrate` wrote for {rig}"
    )
    assert "no such file" in complaint(tmp_path)
    file.write_text(yaml.safe_dump(document | {"cameras": {"left": document["cameras"]["camera_0"]}}))
    assert complaint(out) == f"{file}: cameras: found left, expected those of {rig}: camera_0, camera_1"
    T = make_pose((0.3, -0.2, 0.1), (0.4, -0.2, 0.7)).tolist()
    moved = document["cameras"]["camera_0"] | {"T_camera_lidar": T}
    file.write_text(yaml.safe_dump(document | {"cameras": document["cameras"] | {"camera_0": moved}}))
    assert complaint(out) == (
        f"{out}/camera_0.yaml: found a T_camera_lidar that differs from that in {file}, expected files of one run"
    )
    file.write_text(yaml.safe_dump(document | {"num_sweeps": "three"}))
    assert f"{file}: num_sweeps: " in complaint(out)
    assert not page.exists()


def test_usage(rig: Path, rig_results: Results, tmp_path: Path) -> None:
    page = tmp_path / "p.html"
    for command in (("report", page), ("overlay", tmp_path / "out")):
        result = invoke(
            command[0], rig, rig_results[1], "-o", command[1], "--against", rig.parent / "camera_0"
        )
        assert result.exit_code == 2
        assert f"--against is for one camera, but {rig} is a rig." in result.output
    assert "found suffix '.txt'" in str(
        invoke("report", rig, rig_results[1], "-o", tmp_path / "p.txt").exception
    )
    result = invoke("calibrate", rig, "-o", tmp_path / "out", "--report", tmp_path / "p.txt")
    assert "found suffix '.txt'" in str(result.exception)
    assert not (tmp_path / "out").exists()
