"""Answers of a hub that lies: nothing is written but what was asked for, in the cache, and each answer ends."""

import gzip
import itertools
import re
from collections.abc import Iterator
from pathlib import Path
from time import sleep
from typing import Any

import pytest
from model_hub import Lies, ModelHub
from test_hub import NAME, hub as hub, repository

from semcal_cli.config import file_limits
from semcal_cli.errors import InputError
from semcal_cli.labelling import hub_answers
from semcal_cli.labelling.hub import find_model

AWAY = "../../../../away"
"""From the folder of the contents in the cache to the folder above it."""
HASH = "a" * 64


def endless(part: bytes = bytes(1 << 16)) -> Iterator[bytes]:
    """Yield bytes for ever."""
    return itertools.repeat(part)


def dripping() -> Iterator[bytes]:
    """Yield a byte now and then."""
    while True:
        sleep(0.05)
        yield b" "


def etag(value: str) -> Lies:
    """State another hash of every file."""
    return {"headers": {"X-Linked-Etag": f'"{value}"', "ETag": f'"{value}"'}}


HEX = "needed 40 or 64 hexadecimal digits, as the Hugging Face hub states"
LIES: dict[str, tuple[Lies, str]] = {
    "a hash that leaves the cache": (etag(AWAY), f"found the ETag '\"{AWAY}\"', {HEX}"),
    "a hash that is a path": (etag("TMP/away"), HEX),
    "a hash that is too short": (etag("abc"), HEX),
    "no hash": ({"headers": {"X-Linked-Etag": "", "ETag": ""}}, HEX),
    "the hash of something else": (etag(HASH), f"found content with the hash .*, expected {HASH}, as stated"),
    "a commit that leaves the cache": ({"sha": AWAY}, f"found the commit '{AWAY}', needed 40 hexadecimal"),
    "a commit that is a path": ({"sha": "TMP/away"}, "found the commit .*, needed 40 hexadecimal"),
    "a commit that is no text": ({"sha": [1]}, r"found the commit '\[1\]', needed 40 hexadecimal"),
    "a size that is too small": (
        {"headers": {"X-Linked-Size": "7"}},
        "found more than 7 bytes, expected no more",
    ),
    "a size that is too large": (
        {"headers": {"X-Linked-Size": "70000"}},
        "found [0-9,]+ bytes, needed 70,000, as stated",
    ),
    "a size that is no number": (
        {"headers": {"X-Linked-Size": "-1"}},
        "found the size '-1', expected a number of bytes",
    ),
    "a size of many digits": (
        {"headers": {"X-Linked-Size": "9" * 400}},
        "found the size '9+', expected a number",
    ),
    "a body without an end": ({"body": endless}, "found more than [0-9,]+ bytes, expected no more"),
    "a body that drips": ({"body": dripping}, r"found [0-9]+ bytes in [0-9]+ s, needed 100,000 a second"),
    "a description without an end": ({"told": endless}, r"\(found more than 2,097,152 bytes"),
    "a description that drips": ({"told": dripping}, r"\(found [0-9]+ bytes in"),
    "a description that nests": ({"told": b"[" * 100_000}, r"\(answer.json: nested too deeply\)"),
    "a description that is a list": ({"told": b"[]"}, "found the commit 'None'"),
    "files without names": ({"siblings": [{"rfilename": 5}, 7, None]}, "found no ONNX file"),
    "files above the cache": ({"siblings": [{"rfilename": f"{AWAY}.onnx"}]}, "expected hf:lab/street:FILE"),
    "many parts": (
        {
            "siblings": [
                {"rfilename": f"onnx/model.onnx{end}"} for end in ("", *(f"_data_{n}" for n in range(99)))
            ]
        },
        "found 100 files of the network, needed at most 64",
    ),
    "a compressed body": (
        {"body": gzip.compress(bytes(1 << 20)), "headers": {"Content-Encoding": "gzip"}},
        "found an answer compressed by 'gzip', which was not asked for, expected a plain one",
    ),
    "redirections in a circle": (
        {"status": 302, "to": "/api/models/lab/street/revision/main"},
        "found more than 5 redirections, needed fewer",
    ),
}


def in_folder(value: Any, folder: Path) -> Any:
    """Write the name of a folder into what is said."""
    if isinstance(value, dict):
        return {key: in_folder(item, folder) for key, item in value.items()}
    return value.replace("TMP", str(folder)) if isinstance(value, str) else value


@pytest.mark.parametrize("name", LIES)
def test_a_hub_that_lies_is_one_line_and_writes_nothing(
    name: str, hub: ModelHub, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hub_answers, "ANSWER_S", 1.0)
    hub.add(NAME, repository(tmp_path / "repository"))
    lies, message = LIES[name]
    hub.lies = in_folder(lies, tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    with pytest.raises(InputError, match=message) as caught:
        find_model(f"hf:{NAME}", 1.0)
    assert str(caught.value).isprintable()
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_an_answer_that_never_comes_is_given_up(
    hub: ModelHub, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A header whose bytes come one by one keeps each single wait short."""
    monkeypatch.setattr(hub_answers, "ANSWER_S", 0.2)
    with pytest.raises(ValueError, match=r"found no whole answer, expected one within 0\.2 s"):
        hub_answers.within(0.2, lambda: sleep(2.0))


def test_a_redirection_s_body_is_not_read(
    hub: ModelHub, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The library's client would read it to its end before it goes on."""
    monkeypatch.setattr(hub_answers, "ANSWER_S", 1.0)
    hub.add(NAME, repository(tmp_path / "repository"))
    hub.lies = {"status": 302, "told": endless, "to": "/api/models/lab/street/revision/main"}
    with pytest.raises(InputError, match="found more than 5 redirections"):
        find_model(f"hf:{NAME}", 1.0)


def test_the_limits_are_those_of_the_documentation() -> None:
    assert (file_limits.ANSWER_S, file_limits.MIN_BYTES_PER_S) == (30.0, 100_000.0)


def test_a_password_in_the_address_is_not_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path))
    monkeypatch.setattr("huggingface_hub.constants.ENDPOINT", "http://me:secret@127.0.0.1:9")
    with pytest.raises(InputError, match=re.escape("cannot reach http://127.0.0.1:9 (")) as error:
        find_model(f"hf:{NAME}", 1.0)
    assert "secret" not in str(error.value)
