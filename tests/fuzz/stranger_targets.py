"""Recordings, images and the answers of a hub, each with a check of its reader, as `targets.py` has of documents."""

from __future__ import annotations

import json
import shutil
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError
from semcal_cli.files.image_files import has_16_bits, holds_colors, read_pixels, read_size
from semcal_cli.importing.bags.bag import Bag
from semcal_cli.importing.bags.bag_import import import_bag
from semcal_cli.importing.bags.image_messages import looks_like_mosaic
from semcal_cli.importing.bags.messages import TRANSFORMS, MessageError
from semcal_cli.importing.bags.topics import BagRequest
from semcal_cli.labelling.hub import find_model
from semcal_cli.observations.reading import read_clouds

MAX_DECODED_PIXELS = 1 << 22
"""Larger images are not decoded here, where that would take most of the time; `hostile_growth.py` has them."""
PNG_SIGNATURE, PNG_CHUNK = b"\x89PNG\r\n\x1a\n", struct.Struct(">I4s")
NETWORK = "hf:owner/name"
CACHE = "cache"


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Add the file to refusals that name what is in it instead, such as a topic or a network."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def check_recording(path: Path) -> None:
    """Check a recording: all its messages, and the drive that is made of it, whose files must be read again."""
    folder = path.parent
    out, before = folder / "out", set(folder.iterdir())
    try:
        with naming(path):
            _check_messages(path)
            import_bag(BagRequest([path]), out)
        drive = read_drive(out / "drive.yaml")
        read_clouds(drive)
        for frame in drive.frames:
            assert frame.image is not None
            assert read_size(drive.resolve(frame.image)) == (drive.camera.width, drive.camera.height)
        assert set(folder.iterdir()) == before | {out}, "files beside the drive"
    finally:
        shutil.rmtree(out, ignore_errors=True)


def _check_messages(path: Path) -> None:
    with Bag([path]) as bag:
        for message in bag.messages(bag.topics):
            assert bag.start_ns <= message.received_ns <= bag.end_ns
            with suppress(MessageError):
                # Transforms have a header each.
                assert message.is_a(*TRANSFORMS) or isinstance(message.frame_id, str)
            with suppress(MessageError):
                assert message.content is not None


def write_recording_folder(folder: Path) -> None:
    """Write the file that the metadata of a recording name."""
    (folder / "bag.db3").write_bytes((Path(__file__).parent / "corpus/recording-sqlite/whole").read_bytes())


def check_metadata(path: Path) -> None:
    """Check the metadata of a folder, which names the files of a recording."""
    with naming(path):
        _check_messages(path.parent)


def check_image_file(path: Path) -> None:
    """Check an image, as it is and with the checksums of a PNG made right, which mutations seldom are."""
    content = path.read_bytes()
    if content.startswith(PNG_SIGNATURE):
        with suppress(InputError):
            _check_pixels(path)
        path.write_bytes(with_checksums(content))
    _check_pixels(path)


def _check_pixels(path: Path) -> None:
    holds_colors(path)
    has_16_bits(path)
    width, height = read_size(path)
    assert width > 0
    assert height > 0
    if width * height > MAX_DECODED_PIXELS:
        return
    assert read_pixels(path).shape == (height, width, 3)
    looks_like_mosaic(path)


def with_checksums(png: bytes) -> bytes:
    """Write the checksum of each chunk of a PNG anew."""
    changed, place = bytearray(png), len(PNG_SIGNATURE)
    while place + PNG_CHUNK.size <= len(png):
        length, _ = PNG_CHUNK.unpack_from(png, place)
        end = place + PNG_CHUNK.size + length
        if end + 4 > len(png):
            break
        struct.pack_into(">I", changed, end, zlib.crc32(changed[place + 4 : end]))
        place = end + 4
    return bytes(changed)


def check_answers(path: Path) -> None:
    """Check a hub that gives the answers of a document in turn, and the last one from then on."""
    folder, cache_folder = path.parent, path.parent / CACHE
    before = set(folder.iterdir())
    try:
        with naming(path), _answering(_answers(path.read_bytes()), cache_folder):
            model = find_model(NETWORK, max_mb=1.0)
        assert model.is_file()
        assert cache_folder in model.resolve().parents
    finally:
        assert set(folder.iterdir()) <= before | {cache_folder}, "files outside the cache"
        shutil.rmtree(cache_folder, ignore_errors=True)


def _answers(content: bytes) -> list[tuple[int, dict[str, str], bytes]]:
    """Read answers: status, headers and body; what is no list of them is the body of the only answer."""
    try:
        return [_answer(answer) for answer in json.loads(content)["answers"]] or [(200, {}, content)]
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
        return [(200, {}, content)]


def _answer(answer: dict[str, Any]) -> tuple[int, dict[str, str], bytes]:
    body = answer.get("body", "")
    text = body if isinstance(body, str) else json.dumps(body)
    headers = {
        key.encode("ascii", "ignore").decode(): str(value).encode("ascii", "replace").decode()
        for key, value in answer.get("headers", {}).items()
    }
    return min(max(int(answer.get("status", 200)), 200), 599), headers, text.encode("latin-1", "replace")


@contextmanager
def _answering(answers: list[tuple[int, dict[str, str], bytes]], cache_folder: Path) -> Iterator[None]:
    """Put a hub with these answers in the place of the network, and a folder in that of the user's cache."""
    from huggingface_hub import constants, utils

    module, remaining = _http(), iter(answers)

    def answer(request: Any) -> Any:
        status, headers, body = next(remaining, answers[-1])
        stream = module.ByteStream(b"" if request.method == "HEAD" else body)
        stated = {"Content-Length": str(len(body))} | headers
        return module.Response(status, headers=stated, stream=stream, request=request)

    with (
        module.Client(transport=module.MockTransport(answer)) as client,
        patch.object(utils, "get_session", lambda: client),
        patch.object(constants, "HF_HUB_CACHE", str(cache_folder)),
    ):
        yield


@cache
def _http() -> Any:
    """Return the library of HTTP that the hub's library uses in this version."""
    import sys

    from huggingface_hub import utils

    library: Any = utils
    return sys.modules[type(library.get_session()).__module__.partition(".")[0]]
