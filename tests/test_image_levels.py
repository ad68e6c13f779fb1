"""16-bit images are shown by the bits that the drive's images use, and thermal ones by their quantiles."""

import numpy as np
import pytest
from commands import invoke

from semcal_cli.drive.document import read_drive
from semcal_cli.files.image_files import FULL, Levels, read_image, write_image
from semcal_cli.files.image_levels import ImageLevels, levels_of
from semcal_cli.observations.reading import read_needed_image

DRIVE = """semcal_drive: 1
camera: {model: plumb_bob, width: 64, height: 32, K: [[50, 0, 31.5], [0, 50, 15.5], [0, 0, 1]]}
frames:
- {points: "0.bin", image: "0.png"}
- {points: "1.bin", image: "1.png"}
"""


@pytest.fixture
def picture() -> np.ndarray:
    """Grey values of a picture with shadows and a light."""
    picture = np.random.default_rng(5).integers(0, 256, (32, 64)).astype(np.uint8)
    picture[0, 0] = 255
    return picture


def write_drive(folder, picture, bits, numbers=np.uint16):
    for index in range(2):
        # The first image is dark: only the second shows how many bits the camera has.
        stored = (picture.astype(numbers) << (bits - 8)) >> (4 - 4 * index)
        write_image(stored.astype(numbers), folder / f"{index}.png")
        np.ones((5, 4), np.float32).tofile(folder / f"{index}.bin")
    (folder / "drive.yaml").write_text(DRIVE)
    return read_drive(folder)


@pytest.mark.parametrize("bits", [10, 12, 14, 16])
def test_images_are_scaled_by_the_bits_of_the_drive(tmp_path, picture, bits):
    drive = write_drive(tmp_path, picture, bits)
    dark, bright = (read_needed_image(drive, frame)[..., 1] for frame in drive.frames)
    np.testing.assert_array_equal(bright, picture)
    np.testing.assert_array_equal(dark, picture >> 4)  # one scale for the whole drive
    assert drive.image_levels == (0, 2**bits - 1)
    black_and_white = f"0 is shown as black and {2**bits - 1:,} as white"
    assert black_and_white in invoke("inspect", tmp_path).stdout


def test_images_of_8_bits_stay(tmp_path, picture):
    drive = write_drive(tmp_path, picture, 8, np.uint8)
    np.testing.assert_array_equal(read_needed_image(drive, drive.frames[1])[..., 1], picture)
    assert drive.image_levels is None


def test_levels_are_those_of_the_whole_drive(tmp_path, picture):
    first = write_drive(tmp_path, picture, 12).model_copy(update={"frames": read_drive(tmp_path).frames[:1]})
    assert first.image_levels == (0, 4095)


def test_thermal_images_are_shown_by_quantiles():
    counts = np.zeros(1 << 16, np.int64)
    counts[7200:7700] = 100  # 0.04 K: 288 to 308 K
    counts[0], counts[9500] = 400, 10  # the border of a rectified image, and an exhaust pipe
    assert levels_of(counts) == Levels(7205, 7695)


def test_an_image_of_one_value_has_the_levels_of_its_bits():
    counts = np.zeros(1 << 16, np.int64)
    counts[3000] = 10
    assert levels_of(counts) == Levels(0, 4095)


def test_images_that_cannot_be_read_do_not_count(tmp_path, picture):
    (tmp_path / "broken.png").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(16) + b"\x10")
    write_image(picture.astype(np.uint16) << 4, tmp_path / "whole.png")
    files = [tmp_path / name for name in ("broken.png", "whole.png", "missing.png")]
    assert ImageLevels(files).get() == (0, 4095)


def test_an_image_alone_uses_all_bits(tmp_path, picture):
    write_image(picture.astype(np.uint16) * 257, tmp_path / "a.png")
    np.testing.assert_array_equal(read_image(tmp_path / "a.png")[..., 0], picture)
    assert FULL == (0, 65535)
