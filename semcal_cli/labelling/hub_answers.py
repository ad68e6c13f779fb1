"""Answers of a hub of models, which may be anybody's: each ends after a number of bytes and of seconds.

The library's own download is not used: it names files in the cache by what the server states, and reads what comes.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import partial
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from time import perf_counter
from typing import Any, NamedTuple, TypeVar

from semcal_cli.config.file_limits import ANSWER_S, MAX_ANSWER_BYTES, MAX_REDIRECTS, MIN_BYTES_PER_S
from semcal_cli.errors import mismatch
from semcal_cli.files.documents import parse_any

COMMIT = re.compile(r"[0-9a-f]{40}")
ETAG = re.compile(r'(?:W/)?"?([0-9a-f]{40}|[0-9a-f]{64})"?')
"""The hash of a file: of git, or SHA-256 of large files."""
GIT_DIGITS = 40
TIMEOUT_S = 10.0
"""Longest wait for a connection, and for the next bytes."""
Answer = TypeVar("Answer")


class StatedFile(NamedTuple):
    """A file as the hub describes it."""

    url: str
    """Where it is."""
    digest: str
    """Its hash, 40 hexadecimal digits of git or 64 of SHA-256."""
    num_bytes: int
    """Its size."""


def without_passwords(text: str) -> str:
    """Remove names and passwords from the addresses in a text."""
    return re.sub(r"(?<=://)\S*@", "", text)


def read_json(url: str) -> Any:
    """Read a JSON document.

    Raises:
        ValueError: the answer is too long or too slow.
        InputError: it is no JSON.
        Exception: errors of the library.
    """
    with closing(_follow(url)) as response:
        content = b"".join(_parts(response, MAX_ANSWER_BYTES))
    return parse_any(content.decode(), Path("answer.json"))


def commit_of(info: Any) -> str:
    """Return the commit in the description of a model.

    Raises:
        ValueError: it is no commit of git.
    """
    commit = info.get("sha") if isinstance(info, dict) else None
    if not isinstance(commit, str) or COMMIT.fullmatch(commit) is None:
        raise mismatch(
            f"the commit {str(commit)[:60]!r}", "40 hexadecimal digits, as the Hugging Face hub states"
        )
    return commit


def names_in(info: dict[str, Any]) -> list[str]:
    """List the names of the files in the description of a model."""
    siblings = info.get("siblings")
    items = [item.get("rfilename") for item in siblings or () if isinstance(item, dict)]
    return [name for name in items if isinstance(name, str)]


def describe_file(url: str) -> StatedFile:
    """Ask for the hash and the size of a file.

    Raises:
        ValueError: they are not those of a file of the hub.
        Exception: errors of the library.
    """
    # Other hosts, to which the hub redirects, do not know the hash.
    with closing(_follow(url, "HEAD", is_same_host=True)) as response:
        headers = response.headers
    stated = headers.get("X-Linked-Etag") or headers.get("ETag") or ""
    digest = ETAG.fullmatch(stated)
    if digest is None:
        raise mismatch(
            f"the ETag {stated[:60]!r}", "40 or 64 hexadecimal digits, as the Hugging Face hub states"
        )
    size = headers.get("X-Linked-Size") or headers.get("Content-Length") or ""
    if not (size.isascii() and size.isdigit() and len(size) < 16):
        raise mismatch(f"the size {size[:60]!r}", "a number of bytes")
    return StatedFile(url, digest[1], int(size))


def parts_of(file: StatedFile, on_bytes: Callable[[int], None]) -> Iterator[bytes]:
    """Yield the content of a file, and call `on_bytes` with the number of bytes so far.

    Raises:
        ValueError: the content is not the one that was stated, or comes too slowly.
        Exception: errors of the library.
    """
    is_git = len(file.digest) == GIT_DIGITS
    # The name of a file in git (git-scm.com/book/en/v2/Git-Internals-Git-Objects).
    digest = hashlib.sha1(f"blob {file.num_bytes}\0".encode()) if is_git else hashlib.sha256()
    num_bytes = 0
    with closing(_follow(file.url)) as response:
        for part in _parts(response, file.num_bytes):
            digest.update(part)
            num_bytes += len(part)
            on_bytes(num_bytes)
            yield part
    if num_bytes != file.num_bytes:
        raise mismatch(f"{num_bytes:,} bytes", f"{file.num_bytes:,}, as stated")
    if digest.hexdigest() != file.digest:
        raise mismatch(f"content with the hash {digest.hexdigest()}", f"{file.digest}, as stated")


def _follow(url: str, method: str = "GET", *, is_same_host: bool = False) -> Any:
    """Send a request, and return the answer, whose body is not read yet, after redirections.

    Each redirection is followed here: the library would read its body, however long it is. Other hosts do not get the
    user's token.
    """
    from huggingface_hub import utils

    library: Any = utils  # Its types do not export what its documentation does.
    client = library.get_session()
    headers = library.build_hf_headers(library_name="semcal") | {"Accept-Encoding": "identity"}
    request = client.build_request(method, url, headers=headers, timeout=TIMEOUT_S)
    for _ in range(MAX_REDIRECTS + 1):
        response = within(ANSWER_S, partial(client.send, request, stream=True, follow_redirects=False))
        if not response.is_redirect or response.next_request is None:
            return _accepted(response)
        if is_same_host and response.next_request.url.host != request.url.host:
            return response
        request = response.next_request
        response.close()
    raise mismatch(f"more than {MAX_REDIRECTS} redirections", "fewer")


def _accepted(response: Any) -> Any:
    """Return a successful answer; raise the library's error for others, without their bodies."""
    from huggingface_hub import utils

    library: Any = utils

    if not response.is_success:
        response.close()
        headers = {name: response.headers.get(name, "") for name in ("X-Error-Code", "X-Error-Message")}
        library.hf_raise_for_status(
            type(response)(response.status_code, headers=headers, request=response.request)
        )
        raise mismatch(f"the status {response.status_code}", "an answer")
    if (encoding := response.headers.get("Content-Encoding", "identity")) != "identity":
        response.close()
        raise mismatch(f"an answer compressed by {encoding[:40]!r}, which was not asked for", "a plain one")
    return response


def _parts(response: Any, max_bytes: int) -> Iterator[bytes]:
    """Yield the bytes of an answer."""
    num_bytes, start = 0, perf_counter()
    for part in response.iter_raw():
        num_bytes, seconds = num_bytes + len(part), perf_counter() - start
        if num_bytes > max_bytes:
            raise mismatch(f"more than {max_bytes:,} bytes", "no more")
        if num_bytes < MIN_BYTES_PER_S * (seconds - ANSWER_S):
            raise mismatch(f"{num_bytes:,} bytes in {seconds:.0f} s", f"{MIN_BYTES_PER_S:,.0f} a second")
        yield part


def within(seconds: float, do: Callable[[], Answer]) -> Answer:
    """Do something that may not end, and return its result.

    Raises:
        ValueError: it takes longer.
        Exception: whatever it raises.
    """
    results: SimpleQueue[tuple[Answer | None, Exception | None]] = SimpleQueue()

    def run() -> None:
        try:
            results.put((do(), None))
        except Exception as error:
            results.put((None, error))

    Thread(target=run, daemon=True).start()
    try:
        result, error = results.get(timeout=seconds)
    except Empty:
        raise mismatch("no whole answer", f"one within {seconds:g} s") from None
    if error is not None:
        raise error
    return result  # type: ignore[return-value]
