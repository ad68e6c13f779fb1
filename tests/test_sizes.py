"""How large files may be, and what is opened: the parts of what `hostile_sizes.py` tries through the command."""

import os
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from commands import invoke
from hostile_files import bmp, jpeg, npy, png, sparse

from semcal_cli import core
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError
from semcal_cli.files import rows
from semcal_cli.files.documents import parse
from semcal_cli.files.image_files import holds_colors, read_image, read_size
from semcal_cli.files.input_files import read_bytes, read_text
from semcal_cli.files.point_clouds import read_point_clouds
from semcal_cli.files.yaml_values import MAX_DEPTH
from semcal_cli.observations.reading import read_clouds

MAX_SECONDS = 5.0
"""Time of the processor in which a drive of 10,000 frames is read: it takes a third of a second."""


# Files.


def test_a_limit_counts_every_byte(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(b"12345")
    assert read_bytes(path, limit=5) == b"12345"
    with pytest.raises(InputError, match=r"a\.txt: found 5 bytes, needed at most 4$"):
        read_text(path, limit=4)


def test_files_that_the_system_makes_up_are_read() -> None:
    """Their size is 0."""
    assert read_text(Path("/proc/self/status")).startswith("Name:")


def test_a_pipe_that_takes_a_files_name_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between the test of its kind and its opening."""
    (tmp_path / "a").write_text("")
    regular = (tmp_path / "a").stat()
    os.mkfifo(tmp_path / "pipe")
    monkeypatch.setattr(Path, "stat", lambda self: regular)
    with pytest.raises(InputError, match="pipe: found a special file, expected a file"):
        read_bytes(tmp_path / "pipe")


@pytest.mark.parametrize("path", ["/dev/zero", "/dev/null"])
def test_devices_are_not_opened(path: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="found a special file"):
        read_bytes(Path(path))
    (tmp_path / "a.png").symlink_to(path)
    with pytest.raises(InputError, match="is a special file"):
        core.read_label_images([tmp_path / "a.png"], 1, 1)


# Images.


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp"])
def test_sizes_are_read_from_headers(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    cv2.imwrite(str(path), np.zeros((21, 34, 3), np.uint8))
    assert read_size(path) == (34, 21)
    assert read_image(path, (34, 21)).shape == (21, 34, 3)
    with pytest.raises(InputError, match=r"found 34 x 21 pixels, needed 21 x 34$"):
        read_image(path, (21, 34))
    path.write_bytes(path.read_bytes()[:16])
    with pytest.raises(InputError, match="found a damaged image, expected an intact one"):
        read_image(path, (34, 21))


@pytest.mark.parametrize(
    ("place", "byte"),
    [(11, b"\x0c"), (12, b"X"), (19, b"\0"), (27, b"\1")],
    ids=["length", "name", "no columns", "filter"],
)
def test_the_first_chunk_of_a_png_is_that_of_the_standard(place: int, byte: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), np.zeros((2, 3), np.uint8))
    assert read_size(path) == (3, 2)
    content = path.read_bytes()
    path.write_bytes(content[:place] + byte + content[place + 1 :])
    with pytest.raises(InputError, match="found a damaged image, expected an intact one"):
        read_size(path)


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_colours_of_a_png_are_told_by_its_header(channels: int, kind: type, tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), np.zeros((2, 3, channels), kind))
    assert holds_colors(path) == (channels > 1)
    path.write_bytes(path.read_bytes()[:20])
    assert not holds_colors(path)


@pytest.mark.parametrize("content", [png(12_000, 9_000, 1), jpeg(12_000, 9_000), bmp(12_000, 9_000)])
def test_images_of_too_many_pixels(content: bytes, tmp_path: Path) -> None:
    """The size is that of the image, not of the preview in it, or of rows from the top down."""
    (tmp_path / "a").write_bytes(content)
    assert read_size(tmp_path / "a") == (12_000, 9_000)
    with pytest.raises(InputError, match=r"found 12,000 x 9,000 pixels, needed at most 100,000,000$"):
        read_image(tmp_path / "a")


@pytest.mark.parametrize(
    "rest",
    [
        b"",
        b"\xe0\x00\x00" * 100,
        b"\xe0\x00\x02\xff" * 50_000,
    ],
)
def test_headers_that_state_no_size(rest: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_bytes(b"\xff\xd8\xff" + rest)
    with pytest.raises(InputError, match="found a damaged image"):
        read_size(tmp_path / "a.jpg")


SCANS = b"\xff\xda" * 33


@pytest.mark.parametrize(
    ("before", "after"), [(b"\xff\xe1\0\x44" + SCANS, b""), (b"", SCANS)], ids=["a preview", "a video"]
)
def test_scans_are_those_of_the_jpeg_itself(before: bytes, after: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    cv2.imwrite(str(path), np.full((21, 34, 3), 90, np.uint8))
    content = path.read_bytes()
    path.write_bytes(content[:2] + before + content[2:] + after)
    assert (read_image(path) == 90).all()


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (b"\xff\xff\xda\0\x02" * 33, "33 or more scans"),
        (b"\xff\xfe\0\0" * 10_001, "more than 10,000 segments"),
    ],
)
def test_a_jpeg_of_too_many_parts(more: bytes, told: str, tmp_path: Path) -> None:
    """Bytes of ones may fill the place before a marker, and libjpeg takes a length of 0 for 2."""
    path = tmp_path / "a.jpg"
    cv2.imwrite(str(path), np.zeros((21, 34, 3), np.uint8))
    path.write_bytes(path.read_bytes()[:-2] + more)
    with pytest.raises(InputError, match=f"found a JPEG of {told}, needed at most"):
        read_image(path)


# Sweeps.


@pytest.mark.parametrize("seed", range(20))
def test_a_damaged_png_is_refused_without_words_of_libpng(
    seed: int, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    generator = np.random.default_rng(seed)
    content = cv2.imencode(".png", generator.integers(0, 255, (60, 80, 3), dtype=np.uint8))[1]
    content[generator.integers(40, len(content), 1 + seed % 4)] ^= 1 + seed
    (tmp_path / "a.png").write_bytes(content.tobytes())
    with pytest.raises(InputError, match=r"a\.png: found a damaged image, expected an intact one$"):
        read_image(tmp_path / "a.png")
    assert capfd.readouterr() == ("", "")


def test_a_chunk_of_a_png_that_no_image_needs_may_be_damaged(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    image = np.arange(60, dtype=np.uint8).reshape(4, 5, 3)
    content = cv2.imencode(".png", image)[1].tobytes()
    note = b"\0\0\0\4tEXtnoteXXXX"
    (tmp_path / "a.png").write_bytes(content[:33] + note + content[33:])
    np.testing.assert_array_equal(read_image(tmp_path / "a.png"), image)
    assert capfd.readouterr() == ("", "")


def test_all_sizes_are_judged_before_a_sweep_is_read(tmp_path: Path) -> None:
    (tmp_path / "wrong.bin").write_bytes(b"123")
    sparse(tmp_path / "large.bin", size=1 << 40)
    files = [(tmp_path / name, None) for name in ("wrong.bin", "large.bin")]
    with pytest.raises(InputError, match=r"large\.bin: found 1,099,511,627,776 bytes"):
        read_point_clouds(files)
    with pytest.raises(InputError, match=r"wrong\.bin: 3 bytes is not a multiple of 16"):
        read_point_clouds(files[:1])


def test_labels_are_judged_by_the_points(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(np.ones((2, 4), np.float32).tobytes())
    for name, content, complaint in (
        ("a.label", b"", r"10000000 labels for the 2 points of"),
        ("b.bin", b"", r"40000000 labels for the 2 points of"),
        (
            "a.npy",
            npy("<i8", 4_999_992),
            r"found 40,000,000 bytes, needed at most 10,028 for the 2 points of",
        ),
    ):
        sparse(tmp_path / name, content, 40_000_000)
        with pytest.raises(InputError, match=complaint):
            read_point_clouds([(tmp_path / "a.bin", tmp_path / name)])


def test_max_points_is_asked_for(street: Path) -> None:
    refused = invoke("inspect", street, "--max-points", "1000")
    assert "points, needed at most 1,000: see --max-points" in str(refused.exception)
    drive = read_drive(street, max_points=1000)
    fewer = drive.model_copy(update={"frames": drive.frames[:1]})
    with pytest.raises(InputError, match="needed at most 1,000: see --max-points"):
        read_clouds(fewer)


# Documents.

YAML = """
a: [1, +2, -0, 007, 0x1, 1_000, 1e-3, .5, -2E+1, .inf, -.INF, .nan, 1., 1:30, 99999999999999999999]
no: {yes: no, ~: null, "1": '2', true: FALSE, 3: True}
? b
:
- - c
  - |
    text
     more
- >-
  folded
  text
- "\\u00e4\\n\\x41"
- d   # comment
"""


def test_values_of_yaml_are_those_of_the_core_schema() -> None:
    found = parse(YAML, "yaml")
    assert repr(found["a"]) == (
        "[1, 2, 0, 7.0, '0x1', '1_000', 0.001, 0.5, -20.0, inf, -inf, nan, 1.0, '1:30', 99999999999999999999]"
    )
    assert found["no"] == {"yes": "no", None: None, "1": "2", True: False, 3: True}
    assert found["b"] == [["c", "text\n more\n"], "folded text", "ä\nA", "d"]


@pytest.mark.parametrize(
    "text",
    [
        YAML,
        "",
        "a: 1\na: 2\n",
        "? [a]\n: 1\n",
        "{[a]: 1}\n",
        "a: *b\n",
        "a\n---\nb\n",
        "[" * 101 + "]" * 101,
    ],
)
def test_both_parsers_of_yaml_agree(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """PyYAML's own takes the place of libyaml's where that was not built in."""

    def result() -> str:
        try:
            return repr(parse(text, "yaml"))
        except ValueError as error:
            return str(error)

    found = result()
    monkeypatch.setattr(yaml, "__with_libyaml__", False)
    assert result() == found


def test_a_drive_of_ten_thousand_frames_is_read_in_a_second(street: Path, tmp_path: Path) -> None:
    lines = (street / "drive.yaml").read_text().splitlines(keepends=True)
    start = next(index for index, line in enumerate(lines) if line.startswith("- points:"))
    frame = "".join(lines[start : start + 4]) + "  points_stamp: 12.25\n  image_stamp: 12.5\n"
    end = next(i for i in range(start, len(lines)) if lines[i][0] not in "- ")
    text = "".join(
        [*lines[:start], *(frame.replace("000000", f"{i:06d}") for i in range(10_000)), *lines[end:]]
    )
    (tmp_path / "drive.yaml").write_text(text)
    started = time.process_time()
    assert len(read_drive(tmp_path).frames) == 10_000
    assert time.process_time() - started < MAX_SECONDS


# Rows.


@pytest.mark.parametrize("piece", [1, 2, 7, 1 << 20])
def test_rows_are_those_of_the_list(piece: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = [{"a": index, "b": [1.5, None, "é,]}"]} for index in range(20)]
    path = tmp_path / "a.json"
    monkeypatch.setattr(rows, "PIECE", piece)
    for text in (repr(found).replace("'", '"').replace("None", "null"), " [ ] \n", "[\n{}\n,\n{}\n]"):
        path.write_text(text)
        assert list(rows.read_rows(path)) == parse(text, "json")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "line 1: Expecting value"),
        ("{}", "found a mapping, expected a list of mappings"),
        ("[{},\n 1]", r"\[1\]: found 1, expected a mapping"),
        ("[{}", "line 1: Expecting ',' delimiter"),
        ("[{}]\n1", "line 2: Extra data"),
        ('[{"a": "\\ud800"}]', r"found '\\ud800', expected text without lone surrogates"),
        ('[{"a": ' + "[" * MAX_DEPTH + "]" * MAX_DEPTH + "}]", "nested too deeply"),
        ('[{"a": "' + "x" * rows.MAX_ROW + '"}]', rows.TOO_LONG),
        ("[{" + ", ".join(f'"{index}": true' for index in range(300_000)) + "}]", rows.TOO_LONG),
    ],
)
def test_wrong_rows(text: str, complaint: str, tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(InputError, match=rf"a\.json: {complaint}$"):
        list(rows.read_rows(tmp_path / "a.json"))
