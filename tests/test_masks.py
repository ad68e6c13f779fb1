"""Masked pixels are used by no cue, whatever they show."""

from pathlib import Path
from shutil import copytree

import cv2
import numpy as np
import pytest
import yaml
from commands import invoke, unwrapped

from semcal_cli.checks.inspection import inspect
from semcal_cli.cli.inspect import LABEL_WIDTH
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.estimation.search.visual_motion import _features
from semcal_cli.files.image_files import read_image, write_image
from semcal_cli.files.validation import validate
from semcal_cli.observations.cues.cue_table import load_cues
from semcal_cli.observations.masks import scene_masks, seen_pixels
from semcal_cli.observations.observations import NO_CLASS
from semcal_cli.observations.reading import read_needed_image
from semcal_cli.result.provenance import camera_hash, hash_input
from semcal_cli.synthetic.synthesis import make_camera

WIDTH, HEIGHT = 256, 160
BONNET = [[-1.0, 140.0], [128.0, 110.0], [256.0, 140.0], [256.0, 160.0], [-1.0, 160.0]]
MAX_CHANGED = 1e-3
"""Share of the edge levels that may change: the tail of a blur, beyond three standard deviations, reaches that far."""


@pytest.fixture(scope="module")
def street(tmp_path_factory):
    """A synthetic drive with images, and labels of both sides."""
    drive = tmp_path_factory.mktemp("street") / "drive"
    result = invoke("synth", drive, "--frames", 3, "--width", WIDTH, "--height", HEIGHT, "--seed", 7)
    assert result.exit_code == 0, result.output
    return drive


def masked(drive: Path, mask: object, of_frame: str | None = None):
    """Write the mask into the drive, and into its second frame, and read it."""
    document = yaml.safe_load((drive / "drive.yaml").read_text())
    document["camera"]["mask"] = mask
    if of_frame is not None:
        document["frames"][1]["mask"] = of_frame
    (drive / "drive.yaml").write_text(yaml.safe_dump(document))
    return read_drive(drive)


def below_the_mask(drive: Path, is_scene: np.ndarray) -> None:
    """Draw something else below the mask: stripes in the images, another class in the label images."""
    document = yaml.safe_load((drive / "drive.yaml").read_text())
    stripes = np.indices(is_scene.shape).sum(axis=0) // 5 % 2
    for frame in document["frames"]:
        image, labels = drive / frame["image"], drive / frame["image_labels"]
        pixels = read_image(image)
        pixels[~is_scene] = 255 * stripes[~is_scene, None]
        write_image(pixels, image)
        ids = cv2.imread(str(labels), cv2.IMREAD_UNCHANGED)
        ids[~is_scene] = ids[0, 0] + stripes[~is_scene]
        write_image(ids, labels)


@pytest.mark.parametrize("cue", ["labels", "segments", "edges", "intensity"])
def test_a_cue_does_not_depend_on_what_is_below_the_mask(street, tmp_path, cue):
    drive = masked(copytree(street, tmp_path / "drive"), [BONNET])
    before = load_cues(drive, (cue,)).images
    (is_scene, *_) = scene_masks(drive, drive.frames)
    assert 0.7 < is_scene.mean() < 0.85
    assert is_scene[100, 128]
    assert not is_scene[150, 0]
    below_the_mask(tmp_path / "drive", is_scene)
    after = load_cues(read_drive(tmp_path / "drive"), (cue,)).images
    for first, second in zip(before, after, strict=True):
        assert (first.classes[~is_scene] == NO_CLASS).all()
        assert (first.classes[is_scene] != NO_CLASS).mean() > 0.5
        changed = np.mean(first.classes != second.classes)
        assert changed <= (MAX_CHANGED if cue == "edges" else 0.0)
    unmasked = load_cues(masked(tmp_path / "drive", None), (cue,)).images
    assert np.mean(after[0].classes != unmasked[0].classes) > 0.1


def test_features_of_hand_eye_are_not_on_the_mask(street, tmp_path):
    drive = masked(copytree(street, tmp_path / "drive"), [BONNET])
    image = read_needed_image(drive, drive.frames[0])
    (mask,) = seen_pixels(drive, drive.frames[:1])
    assert len(_features(drive.camera, image, mask).rays) < len(
        _features(drive.camera, image, mask | True).rays
    )
    assert not len(_features(drive.camera, image, mask & False).rays)


def write_images(folder: Path, images: list[np.ndarray]) -> None:
    """Write a drive of images (120, 320)."""
    camera = {
        "model": "plumb_bob",
        "width": 320,
        "height": 120,
        "K": [[160.0, 0, 159.5], [0, 160.0, 59.5], [0, 0, 1]],
    }
    frames = [{"points": "0.bin", "image": f"{index}.png"} for index in range(len(images))]
    for index, image in enumerate(images):
        write_image(image.round().clip(0, 255).astype(np.uint8), folder / f"{index}.png")
    (folder / "drive.yaml").write_text(
        yaml.safe_dump({"semcal_drive": 1, "camera": camera, "frames": frames})
    )


def test_a_mask_is_proposed_from_what_never_changes(tmp_path):
    generator = np.random.default_rng(3)
    texture = cv2.GaussianBlur(generator.normal(0, 400, (120, 2000)), (0, 0), 5.0) + 128
    v, u = np.mgrid[:120, :320]
    is_bonnet = v > 95 + (u - 160) ** 2 / 2000
    bonnet = 90 + 25 * np.sin(u / 12) + generator.normal(0, 20, (120, 320))
    scenes = [texture[:, 140 * index : 140 * index + 320] for index in range(12)]
    gains = generator.uniform(0.9, 1.1, 12)
    images = [np.where(is_bonnet, gain * bonnet, scene) for gain, scene in zip(gains, scenes, strict=True)]
    write_images(tmp_path, images)
    result = invoke("inspect", tmp_path, "--find-mask", tmp_path / "mask.png")
    assert result.exit_code == 0, result.output
    assert (
        "of the image never change; look at it, and use it as `mask: mask.png` under `camera:`"
        in result.stderr
    )
    found = read_image(tmp_path / "mask.png", (320, 120))[..., 0] == 0
    assert found[is_bonnet].mean() > 0.95
    assert found[~is_bonnet].mean() < 0.05
    # What never changes may also be the sky and the vanishing point.
    is_far = ((u > 40) & (u < 120) & (v < 40)) | ((u > 180) & (u < 250) & (v > 20) & (v < 80))
    for others, message in (
        ([np.where(is_far, bonnet, scene) for scene in scenes], "no mask is needed"),
        (scenes, "no mask is needed: all that reaches into the images of"),
        (images[:1] * 12, "half of the pixels change by 0.0 grey values or less over 12 images, needed 10"),
        (images[:3], "found 3 images, needed 8 to find a mask"),
    ):
        write_images(tmp_path, others)
        result = invoke("inspect", tmp_path, "--find-mask", tmp_path / "mask.png")
        assert message in f"{result.stderr} {result.exception}"


@pytest.mark.parametrize("white", [1, 255])
def test_the_masks_of_the_camera_and_of_a_frame_add_up(street, tmp_path, white):
    folder = copytree(street, tmp_path / "drive")
    left, top = (np.full((HEIGHT, WIDTH), white, np.uint8) for _ in range(2))
    left[:, :50] = 0
    top[:40] = 0
    write_image(left, folder / "left.png")
    write_image(top, folder / "top.png")
    drive = masked(folder, "left.png", "top.png")
    masks = scene_masks(drive, drive.frames)
    np.testing.assert_array_equal(masks[0], left > 0)
    np.testing.assert_array_equal(masks[1], (left > 0) & (top > 0))
    assert {"left.png", "top.png"} <= {*drive.files()}
    assert {"left.png", "top.png"} <= hash_input(drive, ["points", "mask"]).keys()


def test_another_mask_makes_no_other_camera(street):
    camera = read_drive(street).camera
    assert camera_hash(camera.model_copy(update={"mask": "mask.png"})) == camera_hash(camera)


@pytest.mark.parametrize(
    ("mask", "message"),
    [
        (5, "camera.mask: found 5, expected text"),
        ([[[0, 0], [1, 1]]], "camera.mask[0]: found a list of 2, needed at least 3"),
        ([[[0, 0], [1, 1], [2, "a"]]], "camera.mask[0][2][1]: found 'a', expected a number"),
        ("missing.png", "missing.png: "),
        ("small.png", "small.png: found 8 x 8 pixels, needed 256 x 160"),
        ("black.png", "camera.mask: found no pixel that is left, expected some that show the scene"),
        ([[[-9, -9], [300, -9], [300, 300], [-9, 300]]], "camera.mask: found no pixel that is left"),
        (
            [BONNET, [[0, 170], [256, 170], [128, 300]]],
            "camera.mask[1]: found a polygon outside the image of 256 x 160, expected corners [u, v] in pixels",
        ),
        (
            "alpha.png",
            "alpha.png: found a mask that is only in the transparency of the image, expected black where",
        ),
    ],
)
def test_a_wrong_mask_is_an_error(street, tmp_path, mask, message):
    folder = copytree(street, tmp_path / "drive")
    write_image(np.zeros((8, 8), np.uint8), folder / "small.png")
    write_image(np.zeros((HEIGHT, WIDTH), np.uint8), folder / "black.png")
    transparent = np.full((HEIGHT, WIDTH, 4), 255, np.uint8)
    transparent[100:, :, 3] = 0
    write_image(transparent, folder / "alpha.png")
    document = yaml.safe_load((folder / "drive.yaml").read_text())
    document["camera"]["mask"] = mask
    (folder / "drive.yaml").write_text(yaml.safe_dump(document))
    result = invoke("calibrate", folder)
    assert result.exit_code == 1
    assert message in str(result.exception)
    inspected = invoke("inspect", folder)
    assert message in f"{unwrapped(inspected.output, LABEL_WIDTH)} {inspected.exception}"


def test_what_masks_hide_is_said(street, tmp_path):
    folder = copytree(street, tmp_path / "drive")
    top = np.full((HEIGHT, WIDTH, 4), 255, np.uint8)
    top[:40, :, :3] = 0
    write_image(top, folder / "top.png")
    masked(folder, [[[0, 120], [255, 120], [255, 159], [0, 159]]], "top.png")
    assert "mask        hides 25.0% to 50.0% of the image" in invoke("inspect", folder).output
    masked(folder, None, "missing.png")
    (suspicion,) = inspect(read_drive(folder)).suspicions
    assert "missing.png: no such file or folder" in suspicion


def test_pixels_beyond_the_lens_are_not_seen():
    K = ((30.0, 0.0, 159.5), (0.0, 30.0, 99.5), (0.0, 0.0, 1.0))
    camera = make_camera(SynthConfig(lens="fisheye", width=320, height=200)).model_copy(update={"K": K})
    document = {"semcal_drive": 1, "camera": camera.model_dump(), "frames": [{"points": "0.bin"}]}
    drive = validate(Drive, document, Path("drive.yaml"))
    (seen,) = seen_pixels(drive, drive.frames)
    assert 0.1 < seen.mean() < 1.0
    assert seen[100, 160]
    assert not seen[0, 0]
