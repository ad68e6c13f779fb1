"""Server of the page, on this machine only, at an address that cannot be guessed."""

from __future__ import annotations

import json
import re
import secrets
import sys
import threading
from collections.abc import Callable
from hmac import compare_digest
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from semcal_cli.errors import InputError, SemcalError, os_reason
from semcal_cli.report.template import render_page
from semcal_cli.report.view.session import Session
from semcal_cli.result.uncertainty import AXIS_NAMES

HOST = "127.0.0.1"
MAX_BODY_BYTES = 10_000
MAX_ERROR = 500
TOKEN_BYTES = 24
IMAGE = re.compile(r"(image|edges|sweep)/([0-9]{1,9})")
HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Content-Security-Policy": "default-src 'none'; img-src 'self' data:; connect-src 'self'; "
    "style-src 'unsafe-inline'; script-src 'unsafe-inline'; base-uri 'none'; form-action 'none'",
}


class ViewServer(ThreadingHTTPServer):
    """Serve the page of one session until it is shut down."""

    daemon_threads = True

    def __init__(self, session: Session, port: int = 0) -> None:
        """Listen on this machine.

        Args:
            session: Session to show.
            port: Port to listen on; 0 takes a free one.

        Raises:
            InputError: the port is not available.
        """
        self.session, self.token = session, secrets.token_urlsafe(TOKEN_BYTES)
        self.ended = threading.Event()
        try:
            super().__init__((HOST, port), Handler)
        except OSError as error:
            raise InputError(f"--port {port}: {os_reason(error)}, expected a free port") from None

    def answer_until_ended(self) -> None:
        """Serve until the page ends it, or until Ctrl-C."""
        threading.Thread(target=self.serve_forever, daemon=True).start()
        try:
            # Waiting in short turns lets Ctrl-C through on every system.
            while not self.ended.wait(timeout=0.5):
                pass
        finally:
            self.shutdown()
            self.server_close()

    @property
    def address(self) -> str:
        """Address of the page, which holds the token."""
        return f"http://{HOST}:{self.server_port}/{self.token}/"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore browsers that close a connection early."""
        if not isinstance(sys.exc_info()[1], ConnectionError | TimeoutError):
            super().handle_error(request, client_address)


class Handler(BaseHTTPRequestHandler):
    """Answer one request."""

    server: ViewServer
    timeout = 30.0
    """Longest silence on a connection, seconds."""
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "semcal", ""

    def log_message(self, format: str, *args: object) -> None:
        """Print nothing."""

    def do_GET(self) -> None:
        """Serve the page, or an image."""
        name, session = self._requested_name(), self.server.session
        if name == "":
            self._answer("text/html; charset=utf-8", lambda: page_html(session).encode())
        elif name is not None and (match := IMAGE.fullmatch(name)):
            kind, frame = match[1], int(match[2])
            self._answer(
                "image/jpeg",
                lambda: (
                    session.sweep(frame) if kind == "sweep" else session.image(frame, by_edge=kind == "edges")
                ),
            )
        else:
            self._refuse(HTTPStatus.NOT_FOUND)

    def do_POST(self) -> None:
        """Answer a request about a pose."""
        session = self.server.session
        names = ("points", "refine", "save", "pick", "pairs")
        questions = {name: getattr(session, name) for name in names}
        if session.output is not None:
            questions["end"] = session.save
        name, length = self._requested_name() or "", self.headers.get("Content-Length", "")
        if name not in questions:
            self._refuse(HTTPStatus.NOT_FOUND)
        elif not (length.isascii() and length.isdecimal()):
            self._refuse(HTTPStatus.LENGTH_REQUIRED)
        elif len(length) > 9 or int(length) > MAX_BODY_BYTES:
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
        else:
            body = self.rfile.read(int(length))
            is_done = self._answer("application/json", lambda: _json(questions[name](_document(body))))
            if name == "end" and is_done:
                self.server.ended.set()

    def _requested_name(self) -> str | None:
        """Return the name of what is asked for, after the token; None if the token is wrong or another site asks."""
        own_hosts = {f"{HOST}:{self.server.server_port}", f"localhost:{self.server.server_port}"}
        origin = self.headers.get("Origin")
        is_own = self.headers.get("Host") in own_hosts and (origin or None) in {
            None,
            *(f"http://{host}" for host in own_hosts),
        }
        token, slash, name = self.path.removeprefix("/").partition("/")
        is_right = compare_digest(token.encode(), self.server.token.encode())
        return name if is_own and is_right and slash else None

    def _answer(self, kind: str, ask: Callable[[], bytes]) -> bool:
        """Send the result, or the error; return whether there is a result."""
        try:
            content = ask()
        except SemcalError as error:
            reason = str(error)
        except OSError as error:
            reason = f"{error.filename or 'view'}: {os_reason(error)}"
        except Exception as error:  # a bug: the page reports it, and the server goes on
            reason = f"semcal failed unexpectedly: {type(error).__name__}: {error}"[:MAX_ERROR]
        else:
            self._send(HTTPStatus.OK, kind, content)
            return True
        self._send(HTTPStatus.BAD_REQUEST, "application/json", _json({"error": reason}))
        return False

    def _refuse(self, status: HTTPStatus) -> None:
        self.close_connection = True
        words = f"{status.phrase}. Open the whole address that semcal view printed, including the port."
        self._send(status, "text/plain", words.encode())

    def _send(self, status: HTTPStatus, kind: str, content: bytes) -> None:
        self.send_response(status)
        for name, value in {"Content-Type": kind, "Content-Length": str(len(content)), **HEADERS}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)


def _json(content: Any) -> bytes:
    return json.dumps(content, allow_nan=False).encode()


def _document(body: bytes) -> dict[str, Any]:
    try:
        document = json.loads(body)
    except (ValueError, RecursionError):
        document = None
    if not isinstance(document, dict):
        raise InputError("view: found no JSON object")
    return document


def page_html(session: Session) -> str:
    """Make the page of a session."""
    return render_page(
        "report/view/view.html",
        ("report/image.js", "report/view/view.js"),
        "report/view/view.css",
        session=session,
        axes=AXIS_NAMES,
        page=session.page,
    )
