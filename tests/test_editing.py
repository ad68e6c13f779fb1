"""Files of a user's are changed in place: every byte outside the replaced values stays as it is."""

import codecs
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from commands import invoke
from format_files import T_ANY
from hypothesis import given
from hypothesis import strategies as st

from semcal_cli.errors import InputError
from semcal_cli.files.documents import parse_any
from semcal_cli.formats import put_transform, read_transform, write_transform
from semcal_cli.formats.editing import edited
from semcal_cli.formats.format import Source

MARK = codecs.BOM_UTF8


def edit(name: str, content: str | bytes, change: Callable[[Any], object]) -> bytes:
    return edited(Source(Path(name), content if isinstance(content, bytes) else content.encode()), change)


def become(wanted: Any) -> Callable[[Any], object]:
    """Change that makes a document another one of the same layout."""

    def change(document: Any) -> None:
        document.clear()
        document.update(wanted)

    return change


class Layout:
    """Draws the text of a document, with an @ for each value to be filled in."""

    def __init__(self, draw: st.DrawFn, is_json: bool) -> None:
        self.draw, self.is_json, self.line_end = draw, is_json, draw(st.sampled_from(["\n", "\r\n"]))

    def one_of(self, *texts: str) -> str:
        return self.draw(st.sampled_from(texts))

    def gap(self) -> str:
        return self.one_of("", " ", self.line_end + "\t" if self.is_json else f" # b: [1{self.line_end}   ")

    def flow(self, depth: int) -> str:
        kind = self.one_of("value", "text", "list", "mapping") if depth else "value"
        if kind == "value":
            return "@"
        if kind == "text":
            return self.one_of('"a, ]}: 1"', '"\\""', "null", "true")
        items = []
        for index in range(self.draw(st.integers(0, 3))):
            key = f'"k{index}"{self.gap() if self.is_json else ""}: ' if kind == "mapping" else ""
            items.append(self.gap() + key + self.flow(depth - 1) + self.gap())
        return ("[{}]" if kind == "list" else "{{{}}}").format(",".join(items))

    def block(self, indent: str) -> str:
        """Lines of a mapping in block style, with blank lines and comments."""
        text, end = "", self.line_end
        for index in range(self.draw(st.integers(1, 3))):
            comment = self.one_of("", "  # of 1 - 2: \u00e9", f"{end}# no{end}")
            kind = self.one_of("flow", "list", "mapping", "folded") if len(indent) < 6 else "flow"
            text += f"{indent}k{index}:"
            if kind == "flow":
                text += f" {self.flow(2)}{comment}{end}"
            elif kind == "folded":
                text += f" |{end}{indent}  a: 1{end}"
            elif kind == "mapping":
                text += comment + end + self.block(indent + "  ")
            else:
                rows = range(self.draw(st.integers(1, 3)))
                text += "".join(f"{end}{indent}- {self.flow(1)}{comment}" for _ in rows) + end
        return text


@st.composite
def texts(draw: st.DrawFn) -> tuple[str, bytes, bytes]:
    """A file, its content, and its content with other values."""
    name = draw(st.sampled_from(["a.json", "a.yaml"]))
    layout = Layout(draw, name == "a.json")
    text = f'{{"k": {layout.flow(3)}{layout.gap()}}}' if layout.is_json else layout.block("")
    numbers = st.floats(-100.0, 100.0).map(lambda number: round(number, 3) + 0.0)
    before = after = draw(st.sampled_from([b"", MARK])).decode() + text
    for _ in range(text.count("@")):
        old = f"{draw(numbers):.6f}"
        new = repr(draw(numbers)) if draw(st.booleans()) else old
        before = before.replace("@", old, 1)
        after = after.replace("@", old if float(old) == float(new) else new, 1)
    return name, before.encode(), after.encode()


@given(drawn=texts())
def test_values_are_replaced_and_all_other_bytes_stay(drawn: tuple[str, bytes, bytes]) -> None:
    name, before, after = drawn
    assert edit(name, before, become(parse_any(after.decode("utf-8-sig"), Path(name)))) == after


ADDED = {"T_camera_lidar": [[1.0, 1e-20], [0.5, -0.0]]}
MATRIX_YAML = "T_camera_lidar:\n- [1.0, 1.0e-20]\n- [0.5, 0.0]"


@pytest.mark.parametrize(
    ("name", "before", "after"),
    [
        ("a.yaml", "a: 1 # one\nb:\n  - 2\n\n# end\n", f"a: 1 # one\nb:\n  - 2\n{MATRIX_YAML}\n\n# end\n"),
        ("a.yaml", "a: 1", f"a: 1\n{MATRIX_YAML}"),
        (
            "a.yaml",
            "a: # none\r\n",
            f"a: # none\r\n{MATRIX_YAML}\r\n".replace("\r", "").replace("\n", "\r\n"),
        ),
        ("a.yaml", "{}\n", "{T_camera_lidar: [[1.0, 1.0e-20], [0.5, 0.0]]}\n"),
        ("a.yaml", "{a: 1, }", "{a: 1, T_camera_lidar: [[1.0, 1.0e-20], [0.5, 0.0]], }"),
        ("a.json", '{"a":1}', '{"a":1, "T_camera_lidar": [[1.0, 1.0e-20], [0.5, 0.0]]}'),
        (
            "a.json",
            '{\r\n\t"a": {}\r\n}',
            '{\r\n\t"a": {},\r\n\t"T_camera_lidar": [\r\n\t  [1.0, 1.0e-20],\r\n\t  [0.5, 0.0]\r\n\t]\r\n}',
        ),
    ],
)
def test_new_keys_follow_the_last_one(name: str, before: str, after: str) -> None:
    assert edit(name, before, lambda document: document.update(ADDED)).decode() == after


@pytest.mark.parametrize(
    ("before", "wanted", "after"),
    [
        ("a: [1, 2] # two\n", [1, 2, 3], "a: [1, 2, 3] # two\n"),
        ("a:\n  - 1\n  - 2\nb: 1\n", [1, 5, 3], "a:\n  - 1\n  - 5\n  - 3\nb: 1\n"),
        ("a:\n  - 1\n  - 2\n# b\nb: 1\n", [[4]], "a:\n  - [4]\n# b\nb: 1\n"),
        ("a:\nb: 1\n", [4], "a: [4]\nb: 1\n"),
        ("a: |\n  text\nb: 1\n", 0.5, "a: 0.5\nb: 1\n"),
        ("{'a':1}", {"b c": "x", "no": None}, """{'a':{"b c": x, "no": null}}"""),
        ("<<: {a: 1}\na: 2\n", 3, "<<: {a: 1}\na: 3\n"),
    ],
)
def test_values_of_another_shape_are_replaced_as_a_whole(before: str, wanted: object, after: str) -> None:
    assert edit("a.yaml", before, lambda document: document.update(a=wanted)).decode() == after


def test_true_is_no_number_and_equal_numbers_stay_as_they_are_written() -> None:
    before = b"a: [1, 1.50, 1e0, true, .nan, -0.0, 0x1]"
    wanted = [1.0, 1.5, 1.0, 1.0, float("nan"), 0.0, "0x1"]
    after = b"a: [1, 1.50, 1e0, 1.0, .nan, -0.0, 0x1]"
    assert edit("a.yaml", before, lambda document: document.update(a=wanted)) == after


def test_a_layout_that_does_not_allow_the_change_is_refused() -> None:
    with pytest.raises(InputError, match=r"^a.yaml: found a layout in which values cannot be replaced"):
        edit("a.yaml", b"a:\n- 1\nb: 2\n", lambda document: document.update(a=3))


def test_a_file_with_the_same_values_is_not_written(tmp_path: Path) -> None:
    file = tmp_path / "chain.yaml"
    rows = f"\ufeffcam0: # left\r\n  T_cam_lidar: {T_ANY.tolist()}\r\n"
    file.write_bytes(rows.encode())
    before = file.stat()
    put_transform(T_ANY, file)
    assert file.read_bytes() == rows.encode()
    assert (file.stat().st_ino, file.stat().st_mtime_ns) == (before.st_ino, before.st_mtime_ns)


def test_what_lies_beside_the_transform_is_not_looked_at(tmp_path: Path) -> None:
    """Dates that are none, numbers that no float holds, and a long list of other things."""
    tail = '"x": 1e400, "y": ' + json.dumps(["2020-02-30", [1] * 1_000_000]) + "}"
    for name, text, after in (
        ("a.yaml", f"cam0:\n  T_cam_lidar: {np.eye(4).tolist()}\ndate: 2020-02-30\n", "\ndate: 2020-02-30\n"),
        ("a.json", '{"CAM": {"lidar2cam": ' + json.dumps(np.eye(4).tolist()) + "}, " + tail, "}, " + tail),
    ):
        file = tmp_path / name
        file.write_text(text)
        put_transform(T_ANY, file)
        np.testing.assert_allclose(read_transform(file), T_ANY, atol=1e-15)
        assert file.read_text().endswith(after)


def numbered(T: Any, text: str) -> str:
    """A text with the numbers of a matrix, by rows, for each @."""
    for value in T.ravel().tolist():
        text = text.replace("@", repr(value), 1)
    return text


ROW = "[@, @, @, @]"
LAYOUTS = {
    "a flat list": "  T_cam_lidar: [@, @, @, @, # x\n    @, @, @, @, # y, up\n    @,@,@,@,   @, @, @, @] # end\n",
    "a flat block list": "  T_cam_lidar:\n" + "".join(f"  - @ # no. {i}\n" for i in range(16)),
    "three rows": f"  T_cam_lidar:\n  - {ROW} # x\n  # y\n  -  {ROW}\n  - {ROW}\n",
    "twelve numbers": f"  T_cam_lidar: [{', '.join(['@'] * 12)}] # p_camera = T p_lidar\n",
    "four rows": "  T_cam_lidar:\n"
    + "".join(f"  - # row {i}\n    - @\n    - @\n    - @ # z\n    - @\n" for i in range(4)),
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_matrix_of_any_layout_keeps_it(name: str, tmp_path: Path) -> None:
    file = tmp_path / "chain.yaml"
    text = f"# rig\ncam0:\n{LAYOUTS[name]}  rostopic: /a # left\n"
    file.write_text(numbered(np.eye(4), text))
    put_transform(T_ANY, file)
    assert file.read_text() == numbered(T_ANY, text)
    np.testing.assert_allclose(read_transform(file), T_ANY, atol=1e-15)


def test_a_second_byte_order_mark_is_named(tmp_path: Path) -> None:
    file = tmp_path / "chain.yaml"
    file.write_bytes(2 * MARK + f"cam0:\n  T_cam_lidar: {np.eye(4).tolist()}\n".encode())
    before = file.read_bytes()
    with pytest.raises(InputError, match=r"chain.yaml: found two byte order marks, needed one or none$"):
        put_transform(T_ANY, file)
    assert file.read_bytes() == before


def test_convert_says_how_far_what_it_sets_is_from_what_was_there(street: Path, tmp_path: Path) -> None:
    T = read_transform(street)
    turned = T.copy()
    turned[:3, 3] += 0.03 * T[:3, 0]  # the camera moves by 3 cm along the LiDAR's x axis
    for name, pose in (("before", T), ("after", turned)):
        write_transform(pose, tmp_path / f"{name}.yaml", "semcal")
    before, after = (str(tmp_path / f"{name}.yaml") for name in ("before", "after"))
    found = invoke("convert", after, "--into", before)
    assert (found.exit_code, found.stdout) == (0, "")
    assert found.stderr == f"set the transform in {before}: moved 0.000 degrees, 3.00 cm\n"
    drive = tmp_path / "drive.yaml"
    document = yaml.safe_load((street / "drive.yaml").read_text())
    del document["T_camera_lidar"]
    drive.write_text(yaml.safe_dump(document))
    found = invoke("convert", after, "--into", drive)
    assert found.stderr == f"set the transform in {drive}, which had none\n"


@pytest.mark.parametrize("key", ["semcal_drive", "semcal_transform"])
def test_what_a_newer_semcal_wrote_is_not_edited(key: str, tmp_path: Path) -> None:
    """There `T_camera_lidar` may mean something else."""
    file = tmp_path / "a.yaml"
    file.write_text(f"{key}: 2\nT_camera_lidar: {np.eye(4).tolist()}\n")
    before = file.read_bytes()
    with pytest.raises(InputError) as refused:
        put_transform(T_ANY, file)
    assert str(refused.value) == f"{file}: {key}: found 2, which a newer semcal wrote, needed 1"
    assert file.read_bytes() == before
