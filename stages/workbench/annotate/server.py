"""The page's server: this machine only, a secret in the address, nothing from the network."""

from __future__ import annotations

import hmac
import json
import secrets
from functools import cached_property
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, unquote

from pydantic import ValidationError

from b23d.stages.workbench.annotate.entries import ConflictError, StaleError
from b23d.stages.workbench.annotate.requests import HitRequest, SaveRequest, told
from b23d.stages.workbench.annotate.walk import Walk

HERE = Path(__file__).parent
REPORT = HERE.parent / "report" / "static"
FILES = {
    "": (HERE / "templates" / "annotate.html", "text/html"),
    "annotate.css": (HERE / "static" / "annotate.css", "text/css"),
    **{f"{name}.js": (HERE / "static" / f"{name}.js", "text/javascript") for name in ("view", "annotate")},
    **{f"{name}.js": (REPORT / f"{name}.js", "text/javascript") for name in ("theme", "balls")},
}
"""What is served as it is: address below the secret → file, type. Light and dark, and keypoints as spheres, are the
report's."""
POLICY = "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; worker-src blob:"
LARGEST = 10_000_000  # bytes of a request


class AnnotationServer(ThreadingHTTPServer):
    """Serves a walk at `url` until `shutdown`: its first shape, another where the address ends in `?shape=<name>`."""

    daemon_threads = True

    def __init__(self, walk: Walk, port: int = 0) -> None:
        """`port` 0: the system chooses. Raises OSError where the port is taken."""
        self.walk, self.token = walk, secrets.token_urlsafe(16)
        super().__init__(("127.0.0.1", port), Handler)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A page that is closed amid an answer is not news."""

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}/{self.token}/"

    @cached_property
    def plotly(self) -> bytes:
        from plotly.offline import get_plotlyjs

        return str(get_plotlyjs()).encode()


class Handler(BaseHTTPRequestHandler):
    """GET: the page, its files, `state`, `reference/<name>`. POST (JSON): `hit`, `save`."""

    server: AnnotationServer
    timeout = 30
    """Seconds: who promises bytes and sends none is not waited for longer."""

    def do_GET(self) -> None:
        path, walk = self._path(), self.server.walk
        if path is None:
            return
        if path in FILES:
            file, kind = FILES[path]
            self._send(200, file.read_bytes(), kind)
        elif path == "plotly.js":
            self._send(200, self.server.plotly, "text/javascript")
        elif path == "state":
            self._answer(lambda: walk.page(self._shape()))
        elif path.startswith("reference/"):
            self._answer(lambda: walk.at(self._shape()).reference(unquote(path.removeprefix("reference/"))))
        else:
            self._send(404, b"no such page", "text/plain")

    def do_POST(self) -> None:
        path, walk = self._path(), self.server.walk
        if path is None:
            return
        body = self._body()
        if body is None:
            return
        if path == "hit":
            self._answer(lambda: walk.at(self._shape()).hit(**HitRequest.model_validate_json(body).model_dump()))
        elif path == "save":
            self._answer(
                lambda: walk.save(self._shape(), **SaveRequest.model_validate_json(body).model_dump(exclude_unset=True))
            )
        else:
            self._send(404, b"no such page", "text/plain")

    def _shape(self) -> str | None:
        """The shape that the page shows; None: the first."""
        return parse_qs(self.path.partition("?")[2]).get("shape", [None])[0]

    def _body(self) -> bytes | None:
        """What was sent; None, answered, where it is no JSON of a size that a page sends."""
        length = self.headers.get("Content-Length") or ""
        if self.headers.get_content_type() != "application/json" or not (length.isascii() and length.isdigit()):
            self._refuse(400, "expected JSON of a known length")
        elif int(length[:12]) > LARGEST:
            self._refuse(413, f"expected at most {LARGEST} bytes")
        else:
            return self.rfile.read(int(length))
        return None

    def _refuse(self, status: int, words: str) -> None:
        """Answer without having read what was sent: the connection cannot be used again."""
        self.close_connection = True
        self._send(status, json.dumps({"error": words}).encode(), "application/json")

    def _path(self) -> str | None:
        """The path below the secret; None, answered, for a stranger, a page of another name that was pointed here, or a
        page of another origin."""
        token, _, path = self.path.partition("?")[0].removeprefix("/").partition("/")
        port = self.server.server_address[1]
        hosts = [f"{host}:{port}" for host in ("127.0.0.1", "localhost")]
        origin = self.headers.get("Origin")
        known = hmac.compare_digest(token.encode(), self.server.token.encode())
        if known and self.headers.get("Host") in hosts and origin in (None, *(f"http://{host}" for host in hosts)):
            return path
        self._refuse(403, "use the whole address that b23d annotate printed")
        return None

    def _answer(self, work: Any) -> None:
        """What `work` gives as JSON; what it raises as a message for the page to show."""
        try:
            status, value = 200, work()
        except ConflictError as error:
            status, value = 409, {"error": str(error), "stale": isinstance(error, StaleError)}
        except ValidationError as error:
            status, value = 400, {"error": f"expected what the page sends, got another request: {told(error.errors())}"}
        except Exception as error:  # whatever it is, the page hears of it and the server goes on
            status = 400 if isinstance(error, ValueError | KeyError | TypeError | IndexError | OSError) else 500
            value = {"error": str(error.args[0] if isinstance(error, KeyError) and error.args else error)}
        self._send(status, json.dumps(value).encode(), "application/json")

    def _send(self, status: int, data: bytes, kind: str) -> None:
        self.send_response(status)
        headers = {
            "Content-Type": f"{kind}; charset=utf-8",
            "Content-Length": str(len(data)),
            "Cache-Control": "no-store",
            "Content-Security-Policy": POLICY,
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
        }
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, format: str, *args: Any) -> None:
        """Requests are not news."""
