"""A hub of models on the loopback interface, as much of Hugging Face's as its library asks of one."""

from __future__ import annotations

import hashlib
import json
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

Lies = dict[str, Any]
Body = bytes | Callable[[], Iterable[bytes]]


@dataclass
class Repository:
    """A model: its files at each revision."""

    revisions: dict[str, dict[str, bytes]]
    gate: int = 0
    """Status with which files are refused: 401 or 403; 0 if they are not."""

    def add(self, folder: Path, revision: str = "main") -> None:
        """Add the files of a folder."""
        files = {
            path.relative_to(folder).as_posix(): path.read_bytes()
            for path in folder.rglob("*")
            if path.is_file()
        }
        self.revisions[revision] = files

    def files(self, revision: str) -> tuple[str, dict[str, bytes]] | None:
        """Find a revision by its name or its commit: its commit and its files."""
        for name, files in self.revisions.items():
            content = json.dumps([name, {key: hashlib.sha1(data).hexdigest() for key, data in files.items()}])
            commit = hashlib.sha1(content.encode()).hexdigest()
            if revision in (name, commit):
                return commit, files
        return None


@dataclass
class ModelHub:
    """The hub."""

    address: str = ""
    repositories: dict[str, Repository] = field(default_factory=dict)
    fetched: list[str] = field(default_factory=list)
    """Files that were sent."""
    is_broken: bool = False
    """Whether every answer is a failure of the server."""
    lies: Lies = field(default_factory=dict)
    """What is not said as it is: `sha` and `siblings` of a model, or all that is
    `told`, where it redirects `to`, headers of a file, and its `body`; `status` of all answers."""

    def add(self, name: str, folder: Path, revision: str = "main", gate: int = 0) -> None:
        """Add a folder as a revision of a model."""
        self.repositories.setdefault(name, Repository({}, gate)).add(folder, revision)

    def commit(self, name: str, revision: str = "main") -> str:
        """Return the commit of a revision."""
        commit_and_files = self.repositories[name].files(revision)
        assert commit_and_files is not None
        return commit_and_files[0]


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    hub: ModelHub

    def do_HEAD(self) -> None:
        self.do_GET(is_head=True)

    def do_GET(self, is_head: bool = False) -> None:
        parts = [unquote(part) for part in urlsplit(self.path).path.strip("/").split("/")]
        if self.hub.is_broken:
            self._answer(503)
        elif parts[:2] == ["api", "models"]:
            self._tell("/".join(parts[2:4]), parts[5])
        elif len(parts) < 5:
            self._answer(404)  # what else the library asks
        else:
            self._send("/".join(parts[:2]), parts[3], "/".join(parts[4:]), is_head)

    def _find(self, name: str, revision: str) -> tuple[str, dict[str, bytes]] | None:
        if name not in self.hub.repositories:
            self._answer(401, {"X-Error-Code": "RepoNotFound"})
            return None
        commit_and_files = self.hub.repositories[name].files(revision)
        if commit_and_files is None:
            self._answer(404, {"X-Error-Code": "RevisionNotFound"})
        return commit_and_files

    def _tell(self, name: str, revision: str) -> None:
        if commit_and_files := self._find(name, revision):
            commit, files = commit_and_files
            siblings = [{"rfilename": file, "size": len(data)} for file, data in files.items()]
            told = {"id": name, "sha": commit, "siblings": siblings} | self.hub.lies
            headers = {"Location": self.hub.lies["to"]} if "to" in self.hub.lies else {}
            self._answer(200, headers, self.hub.lies.get("told") or json.dumps(told, default=str).encode())

    def _send(self, name: str, revision: str, file: str, is_head: bool) -> None:
        if not (commit_and_files := self._find(name, revision)):
            return
        commit, files = commit_and_files
        if gate := self.hub.repositories[name].gate:
            self._answer(gate, {"X-Error-Code": "GatedRepo"})
        elif file not in files:
            self._answer(404, {"X-Error-Code": "EntryNotFound", "X-Repo-Commit": commit})
        else:
            content = files[file]
            # As the hub does: files in git have git's hash, networks have SHA-256.
            etag = hashlib.sha256(content).hexdigest()
            if file.endswith(".json"):
                etag = hashlib.sha1(f"blob {len(content)}\0".encode() + content).hexdigest()
            sizes = {"X-Linked-Size": str(len(content)), "X-Linked-Etag": f'"{etag}"', "ETag": f'"{etag}"'}
            if not is_head:
                self.hub.fetched.append(file)
            headers = {"X-Repo-Commit": commit, **sizes, **self.hub.lies.get("headers", {})}
            self._answer(200, headers, self.hub.lies.get("body", content), is_head=is_head)

    def _answer(
        self, status: int, headers: dict[str, str] | None = None, body: Body = b"", is_head: bool = False
    ) -> None:
        said = {"Content-Length": str(len(body))} if isinstance(body, bytes) else {"Connection": "close"}
        self.send_response(self.hub.lies.get("status", status))
        for key, value in {**said, **(headers or {})}.items():
            self.send_header(key, value)
        self.end_headers()
        with suppress(OSError):  # The other side had enough.
            for part in () if is_head else [body] if isinstance(body, bytes) else body():
                self.wfile.write(part)

    def log_message(self, format: str, *args: object) -> None:
        pass


@contextmanager
def serve() -> Iterator[ModelHub]:
    """Serve a hub on a free port of the loopback interface."""
    hub = ModelHub()
    server = ThreadingHTTPServer(("127.0.0.1", 0), type("Handler", (_Handler,), {"hub": hub}))
    hub.address = f"http://127.0.0.1:{server.server_address[1]}"
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield hub
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
