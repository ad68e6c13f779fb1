"""Networks on the Hugging Face hub, fetched by name into the cache of the hub's own library."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import NamedTuple
from urllib.parse import quote

from semcal_cli.config.file_limits import MAX_NETWORK_FILES
from semcal_cli.errors import InputError, check_installed, listed, mismatch, reason
from semcal_cli.events import Listener, Progress, StageDone, ignore
from semcal_cli.files.input_files import FILE, kind_of
from semcal_cli.files.output_files import make_folder, write_parts, write_text
from semcal_cli.labelling.hub_answers import (
    StatedFile,
    commit_of,
    describe_file,
    names_in,
    parts_of,
    read_json,
    without_passwords,
)

PREFIX = "hf:"
NAME = re.compile(r"hf:(?P<repo>[\w.-]+/[\w.-]+)(@(?P<revision>[\w./-]+))?(:(?P<file>[\w./-]+\.onnx))?")
SYNTAX = "hf:OWNER/NAME, hf:OWNER/NAME@REVISION or hf:OWNER/NAME@REVISION:FILE.onnx"
USUAL = ("onnx/model.onnx", "model.onnx")
"""Model files to look for if none is named; the first that exists is used."""
SIDECARS = ("config.json", "preprocessor_config.json", "processor_config.json")
"""Files that describe the preprocessing and the classes of a transformers model."""
EXTERNAL = ("_data", ".data")
"""Suffixes, after the name of a model, of the files with its weights."""
SNAPSHOT = re.compile(r"/models--([^/]+)/snapshots/([0-9a-f]{40})/(.+)$")
"""Path of a file in the cache: its repository, its commit and its name in the repository."""
MEGABYTE = 1e6
_PIECE_BYTES = 1 << 20
"""Bytes that are copied at a time."""
REFUSALS = (401, 403, 404)
"""HTTP statuses of a network that is private, gated or missing."""


class Recommended(NamedTuple):
    """A network that has a short name."""

    repository: str
    megabytes: int
    """Size of its 32-bit weights."""
    classes: str
    licence: str


RECOMMENDED = {
    "cityscapes": Recommended(
        "Xenova/segformer-b0-finetuned-cityscapes-1024-1024",
        15,
        "19 classes of Cityscapes",
        "NVIDIA Source Code License for SegFormer: non-commercial",
    ),
    "ade20k": Recommended(
        "Xenova/segformer-b0-finetuned-ade-512-512",
        15,
        "150 classes of ADE20K",
        "NVIDIA Source Code License for SegFormer: non-commercial",
    ),
}
"""Networks by short name. The revision is `main` unless one is named."""


@dataclass(frozen=True)
class HubName:
    """Name of a network on the hub, as the user writes it."""

    text: str
    repo: str
    revision: str
    file: str | None
    """File in the repository; None for the usual one."""

    @property
    def files(self) -> tuple[str, ...]:
        """Possible model files; the first that exists is used."""
        return USUAL if self.file is None else (self.file,)

    def error(self, found: str, needed: str) -> InputError:
        """Make the error about this network."""
        return InputError(f"{self.text}: {mismatch(without_passwords(found), without_passwords(needed))}")


def is_hub_name(name: str) -> bool:
    """Return whether a name belongs to the hub rather than to a file."""
    return name.startswith(PREFIX) or (name in RECOMMENDED and not Path(name).exists())


def find_model(name: str, max_mb: float, on_event: Listener = ignore) -> Path:
    """Find the file of a network. One on the hub is fetched with its sidecars, unless it is cached.

    Args:
        name: A file, a name on the hub (`hf:OWNER/NAME@REVISION:FILE`), or a short name of `RECOMMENDED`.
        max_mb: Largest download, megabytes.
        on_event: Called with each event.

    Raises:
        InputError: the network is missing, gated or too large, or neither the hub nor the cache has it.
    """
    if not is_hub_name(name):
        if not Path(name).suffix and not Path(name).exists():
            raise InputError(
                f"found network {name!r}, expected a file, {SYNTAX}, or one of: {', '.join(RECOMMENDED)}"
            )
        return Path(name)
    text = name if name.startswith(PREFIX) else PREFIX + RECOMMENDED[name].repository
    parts = NAME.fullmatch(text)
    if parts is None or ".." in text or (parts["revision"] or "").startswith("/"):
        raise InputError(f"{text}: is not the name of an ONNX network on the hub, expected {SYNTAX}")
    hub = HubName(text, parts["repo"], parts["revision"] or "main", parts["file"])
    check_installed(text, "huggingface_hub", "label")
    with _translated_errors(hub):
        return _fetch_files(hub, max_mb, on_event)


def hub_name(path: Path) -> str | None:
    """Return the hub name, with its commit, of a file in the cache; None for any other file."""
    parts = SNAPSHOT.search(path.absolute().as_posix())
    return None if parts is None else f"{PREFIX}{parts[1].replace('--', '/', 1)}@{parts[2]}:{parts[3]}"


def copy_network(model: Path, folder: Path) -> Path:
    """Copy a network of the cache into a folder that is laid out like the cache, without links, to carry it elsewhere.

    Args:
        model: Its file in the cache.
        folder: Where to; HF_HUB_CACHE may name it on the other machine.

    Returns:
        The copied model. Its path still tells its name on the hub, so that its licence is known there.

    Raises:
        InputError: the network is not from the hub, or cannot be copied.
    """
    path = model.absolute()
    parts = SNAPSHOT.search(path.as_posix())
    if parts is None:
        raise InputError(f"{model}: {mismatch('a file of your own', f'a network on the hub: {SYNTAX}')}")
    name = parts[3]
    snapshot = path.parents[name.count("/")]
    repository = snapshot.parents[1]
    target = folder / repository.name
    names = [path.relative_to(snapshot).as_posix() for path in snapshot.rglob("*") if path.is_file()]
    for each in sorted(each for each in names if each in SIDECARS or each == name or _is_part(each, name)):
        copy = target / "snapshots" / snapshot.name / each
        make_folder(copy.parent)
        with (snapshot / each).open("rb") as content:
            write_parts(iter(partial(content.read, _PIECE_BYTES), b""), copy)
    for reference in (repository / "refs").rglob("*"):
        if reference.is_file() and reference.read_text() == snapshot.name:
            copy = target / reference.relative_to(repository)
            make_folder(copy.parent)
            write_text(snapshot.name, copy)
    return target / "snapshots" / snapshot.name / name


def licence_of(path: Path) -> str | None:
    """Look up the licence of a file in the cache, if its repository is one of `RECOMMENDED`."""
    name = hub_name(path) or ""
    licences = (
        network.licence
        for network in RECOMMENDED.values()
        if name.startswith(f"{PREFIX}{network.repository}@")
    )
    return next(licences, None)


def _fetch_files(hub: HubName, max_mb: float, on_event: Listener) -> Path:
    """Fetch the files that the cache lacks. The model comes last, so that a cached model is complete."""
    import huggingface_hub
    from huggingface_hub.errors import HfHubHTTPError

    start, endpoint = perf_counter(), huggingface_hub.constants.ENDPOINT
    address = f"{endpoint}/api/models/{hub.repo}/revision/{quote(hub.revision, safe='')}"
    try:
        info = read_json(address)
    except Exception as error:  # Which errors the library raises without a connection depends on its version.
        if isinstance(error, HfHubHTTPError) and error.response.status_code in REFUSALS:
            raise
        return _find_cached(hub, endpoint, error)
    commit, names = commit_of(info), names_in(info)
    model = _choose_model(hub, names)
    chosen = [name for name in names if name in SIDECARS or _is_part(name, model)] + [model]
    if len(chosen) > MAX_NETWORK_FILES:
        raise hub.error(f"{len(chosen):,} files of the network", f"at most {MAX_NETWORK_FILES}")
    cache = _Cache(hub.repo, commit)
    addresses = {name: huggingface_hub.hf_hub_url(hub.repo, name, revision=commit) for name in chosen}
    files = {name: describe_file(addresses[name]) for name in chosen if not cache.has(name)}
    missing = [file for file in files.values() if not cache.has_content(file)]
    size_mb = sum(file.num_bytes for file in missing) / MEGABYTE
    if size_mb > max_mb:
        raise hub.error(
            f"{size_mb:,.1f} MB to fetch", f"at most {max_mb:g} MB; --max-download-mb allows more"
        )
    for name, file in files.items():
        if file in missing:
            step, total = f"fetching {name} of {hub.repo}", f" of {file.num_bytes / MEGABYTE:.1f} MB"

            def tell(num_bytes: int, step: str = step, total: str = total) -> None:
                on_event(Progress(f"{step}: {num_bytes / MEGABYTE:.1f}{total}"))

            cache.write_content(file, parts_of(file, tell))
        cache.link(name, file)
    cache.name_commit(hub.revision)
    path = cache.path(model)
    if missing:
        note = f"{hub_name(path) or hub.text}: {len(missing)} files, {size_mb:.1f} MB"
        on_event(StageDone("fetched", perf_counter() - start, note))
    return path


class _Cache:
    """A commit of a network in the library's cache, laid out as the library does it.

    Names of files in it are those that semcal asks for, and hashes that are hexadecimal digits.
    """

    def __init__(self, repo: str, commit: str) -> None:
        from huggingface_hub import constants

        self._folder = Path(constants.HF_HUB_CACHE) / f"models--{repo.replace('/', '--')}"
        self._commit = commit

    def path(self, name: str) -> Path:
        """Name a file of the network."""
        return self._folder / "snapshots" / self._commit / name

    def has(self, name: str) -> bool:
        """Return whether a file of the network is there."""
        return self.path(name).is_file()

    def has_content(self, file: StatedFile) -> bool:
        """Return whether a content is there, of this network at any commit."""
        blob = self._blob(file)
        return kind_of(blob) == FILE and blob.stat().st_size == file.num_bytes

    def write_content(self, file: StatedFile, parts: Iterable[bytes]) -> None:
        """Write a content, as a whole or not at all."""
        make_folder(self._blob(file).parent)
        write_parts(parts, self._blob(file))

    def link(self, name: str, file: StatedFile) -> None:
        """Let a file of the network be a content that is there, by a link, or a copy where the disk has no links."""
        path, blob = self.path(name), self._blob(file)
        make_folder(path.parent)
        path.unlink(missing_ok=True)
        try:
            path.symlink_to(os.path.relpath(blob, path.parent))
        except OSError:
            shutil.copyfile(blob, path)

    def name_commit(self, revision: str) -> None:
        """Note that a branch or a tag is this commit, so that it is found without the hub."""
        if revision != self._commit:
            file = self._folder / "refs" / revision
            make_folder(file.parent)
            write_text(self._commit, file)

    def _blob(self, file: StatedFile) -> Path:
        return self._folder / "blobs" / file.digest


def _choose_model(hub: HubName, siblings: Iterable[str]) -> str:
    names = set(siblings)
    if model := next(filter(names.__contains__, hub.files), None):
        return model
    networks = sorted(name for name in names if name.endswith(".onnx"))
    if networks:
        file = hub.file or "no " + " or ".join(USUAL)
        raise hub.error(f"{file} among {listed(networks)}", f"{PREFIX}{hub.repo}:FILE with one of them")
    weights = [
        name for name in names if name.endswith((".bin", ".pt", ".pth", ".safetensors", ".h5", ".msgpack"))
    ]
    raise hub.error(
        f"no ONNX file (weights: {listed(sorted(weights))})",
        "a repository with onnx/model.onnx, such as those of Xenova and onnx-community",
    )


def _is_part(name: str, model: str) -> bool:
    """Return whether a file holds weights of a model: model.onnx_data, model.onnx_data_1, model.onnx.data."""
    return any(re.fullmatch(re.escape(model + end) + r"(_\d+)?", name) for end in EXTERNAL)


def _find_cached(hub: HubName, endpoint: str, error: Exception) -> Path:
    """Find a network in the cache, without the hub."""
    import huggingface_hub

    for file in hub.files:
        path = huggingface_hub.try_to_load_from_cache(hub.repo, file, revision=hub.revision)
        if isinstance(path, str):
            return Path(path)
    shown, failure = without_passwords(endpoint), without_passwords(reason(error))[:200]
    raise InputError(
        f"{hub.text}: cannot reach {shown} ({failure}), and the network is not cached. Fetch it where there is a "
        f"connection by `semcal label --download {hub.text} --to DIR`, and set HF_HUB_CACHE=DIR here; or calibrate "
        "without labels, from a start: --init FILE"
    )


@contextmanager
def _translated_errors(hub: HubName) -> Iterator[None]:
    """Raise the errors of the hub as one line."""
    from huggingface_hub import constants, errors

    try:
        yield
    except errors.GatedRepoError:
        terms = (
            f"accept its terms at {constants.ENDPOINT}/{hub.repo} and log in with `hf auth login` or HF_TOKEN"
        )
        raise hub.error("a gated model", f"access to it: {terms}") from None
    except errors.RepositoryNotFoundError:
        needed = "a public one, or a login with `hf auth login` or HF_TOKEN"
        raise hub.error(f"no such model at {constants.ENDPOINT}, or it is private", needed) from None
    except errors.RevisionNotFoundError:
        raise hub.error(f"no revision {hub.revision!r}", "a branch, a tag or a commit") from None
    except InputError:
        raise
    except Exception as error:  # The connection, the disk or a dependency of the library.
        failure = without_passwords(reason(error))[:300]
        raise InputError(f"{hub.text}: could not be fetched: {failure}") from None
