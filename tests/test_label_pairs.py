"""Two networks label the same images: their labels, and how far they differ."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from commands import invoke as run
from networks import POINT_CARD, STREET_COLORS, card, color_network, range_network, street_network

from semcal_cli.drive.document import read_drive
from semcal_cli.labelling.sweep_labeller import SweepLabeller
from semcal_cli.observations.reading import read_label_images


def two_networks(folder: Path, names: list[str]) -> list[object]:
    """Options for two networks: the second takes roads for green and the other way round."""
    (folder / "b").mkdir()
    nets = street_network(folder), folder / "b/net.onnx"
    color_network(nets[1], stride=2, colors=STREET_COLORS[[0, 2, 1, 3]])
    card(folder / "b", classes=names, licence="of nobody")
    return [word for net in nets for word in ("--image-model", net)]


@pytest.mark.parametrize("is_renamed", [False, True])
def test_a_second_network_tells_how_far_both_agree(plain: Path, tmp_path: Path, is_renamed: bool) -> None:
    """By other names, the second gives the same answer."""
    names = ["Himmel", "gruen", "Strasse", "braun"] if is_renamed else ["sky", "road", "green", "brown"]
    models, out = two_networks(tmp_path, names), tmp_path / "out"
    result = run("label", plain, *models, "-o", out)
    assert result.exit_code == 0, result.output
    assert "licence of net.onnx: of nobody" in result.output
    drives = [read_drive(out / name) for name in ("drive.yaml", "drive_2.yaml")]
    assert drives[0].networks is not None
    assert drives[0].networks.second is not None
    share = drives[0].networks.second.disagreement
    assert drives[1].networks is not None
    assert drives[1].networks.image is not None
    assert drives[1].networks.image.licence == "of nobody"
    first, second = (
        np.stack([cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in sorted((out / name).glob("*.png"))])
        for name in ("image_labels", "image_labels_2")
    )
    assert share == pytest.approx(0.0 if is_renamed else (first != second).mean(), abs=0.01)
    assert 0.2 < (first != second).mean() < 0.8
    line = f"the second network (drive_2.yaml) differs in {share:.1%} of the pixels"
    assert line in result.output
    assert line in run("inspect", out).output
    assert "networks" in run("inspect", out, "--json").output
    assert "found 3, needed at most 2" in run("label", plain, *models, *models[:2], "-o", out).output


@pytest.mark.parametrize("command", ["calibrate", "batch"])
def test_a_calibration_uses_the_first_of_two_networks(
    plain: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    models = two_networks(tmp_path, ["sky", "road", "green", "brown"])
    assert run("label", plain, *models, "-o", tmp_path / "labelled").exit_code == 0
    monkeypatch.chdir(tmp_path)
    short = [word if isinstance(word, str) else word.relative_to(tmp_path) for word in models]
    options = [*short, "--no-polish"]
    result = tmp_path / "out.yaml"
    if command == "batch":
        (result,) = [tmp_path / "results" / str(plain).lstrip("/") / "calibration.yaml"]
        ending = run("batch", plain, "-o", tmp_path / "results", "--", *options)
    else:
        ending = run("calibrate", plain, *options, "-o", result)
    assert ending.exit_code in (0, 3), ending.output
    written = yaml.safe_load(result.read_text())
    networks, labelled = written["input"]["networks"], read_drive(tmp_path / "labelled").networks
    assert labelled is not None
    assert labelled.image is not None
    assert labelled.second is not None
    assert networks["image"]["sha256"] == labelled.image.sha256
    assert networks["second"]["disagreement"] == labelled.second.disagreement
    second_name = networks["second"]["drive"]
    share = labelled.second.disagreement
    assert written["notes"] == [f"the second network ({second_name}) differs in {share:.1%} of the pixels"]
    (second,) = plain.glob(f".semcal_labels/{Path(second_name).parent.name}/drive_*.yaml")
    old, new = (read_label_images(read_drive(path)) for path in (tmp_path / "labelled/drive_2.yaml", second))
    assert np.array_equal(old, new)


def test_two_image_networks_label_each_sweep_once(
    plain: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    models = two_networks(tmp_path, ["sky", "road", "green", "brown"])
    (tmp_path / "c").mkdir()
    net = range_network(tmp_path / "c/net.onnx", 5, 16, 128, 1, 0.0)
    (tmp_path / "c/net.yaml").write_text(yaml.safe_dump(POINT_CARD))
    ids, labelled = SweepLabeller.ids, []
    monkeypatch.setattr(SweepLabeller, "ids", lambda self, cloud: labelled.append(1) or ids(self, cloud))
    arguments = ("label", plain, *models, "--point-model", net, "-o", tmp_path / "out")
    num_frames = len(read_drive(plain).frames)
    for options, count in (((), num_frames), ((), num_frames), (("--force",), 2 * num_frames)):
        assert run(*arguments, *options).exit_code == 0
        assert len(labelled) == count


def test_an_image_that_only_the_second_network_misses_is_named(plain: Path, tmp_path: Path) -> None:
    net, image = street_network(tmp_path), min((plain / "images").iterdir())
    arguments = ("label", plain, "-o", tmp_path / "out", "--image-model", net)
    assert run(*arguments).exit_code == 0
    image.write_bytes(image.read_bytes()[:900])
    result = run(*arguments, "--image-model", shutil.copy(net, tmp_path / "net_2.onnx"), "--force")
    assert f"frames failed; {image}: found a damaged image" in str(result.exception)
