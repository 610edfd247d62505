"""The page of a run: a server on this machine alone, which nothing outside reaches and which reaches nothing outside."""

from __future__ import annotations

import json
import secrets
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from stepblocks.errors import StepblocksError
from stepblocks.page_file import render_page
from stepblocks.study.conduct import Run
from stepblocks.study.hands import Mouse
from stepblocks.study.servo import hurry

_LARGEST = 20_000  # bytes of a request
_POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; connect-src 'self'"
_PULL = 400  # pixels to the right of the edge that are there on every screen
_LINGER = 1.5  # the page still shows that the run is done [s]


class RunServer(ThreadingHTTPServer):
    """Serves one run until it is done; `url` is where."""

    daemon_threads = True

    def __init__(self, run: Run, port: int = 0) -> None:
        super().__init__(("127.0.0.1", port), _Handler)
        self.experiment, self.token = run, secrets.token_urlsafe(16)
        self.url = f"http://127.0.0.1:{self.server_address[1]}/"

    def until_done(self) -> None:
        """Serve until the last answer is given."""
        if self.experiment.virtual:
            hurry(10)
        try:
            self.serve_forever(poll_interval=0.1)
        finally:
            self.server_close()
            self.experiment.close()


class _Handler(BaseHTTPRequestHandler):
    server: RunServer
    protocol_version = "HTTP/1.1"

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing: the terminal is the experimenter's."""

    def do_GET(self) -> None:
        run = self.server.experiment
        if not self._ours(None):
            return
        if self.path == "/":
            told = {"participant": run.participant, "virtual": run.virtual, "token": self.server.token}
            page = render_page("study", "run.html", metres=max(1e-4, 1.2 * run.reach / _PULL), **told)
            self._send(200, page, "text/html; charset=utf-8")
        elif self.path == "/state":
            self._json(200, run.state())
        else:
            self._json(404, {"error": "there is nothing here"})

    def do_POST(self) -> None:
        run, size = self.server.experiment, int(self.headers.get("Content-Length") or 0)
        content = self.rfile.read(min(size, _LARGEST))
        # a page of somebody else in the same browser knows no token
        if not self._ours(self.headers.get("X-Stepblocks")):
            return
        try:
            asked = json.loads(content) if size <= _LARGEST else None
            if not isinstance(asked, dict):
                raise ValueError("a JSON object is expected")
            if self.path == "/hand":
                if isinstance(run.hand, Mouse):
                    run.hand.post(min(max(float(asked["x"]), -1.0), 1.0), bool(asked["held"]))
                return self._json(200, run.felt())
            if self.path == "/begin":
                run.begin()
            elif self.path == "/answer":
                run.answer(str(asked["trial"]), {str(name): str(text) for name, text in asked["answers"].items()})
                if run.now is None:
                    threading.Timer(_LINGER, self.server.shutdown).start()
            else:
                return self._json(404, {"error": "there is nothing here"})
            self._json(200, run.state())
        except StepblocksError as error:
            self._json(422, {"error": str(error)})
        except (ValueError, KeyError, TypeError, AttributeError):
            self._json(400, {"error": "the request is not one of this page"})

    def _ours(self, token: str | None) -> bool:
        """Whether a request is meant for this machine, and where it changes something, comes from this page."""
        local = (self.headers.get("Host") or "").rpartition(":")[0] in ("127.0.0.1", "localhost")
        if local and (self.command == "GET" or secrets.compare_digest(token or "", self.server.token)):
            return True
        self._json(403, {"error": "only the page of this run may ask this"})
        return False

    def _json(self, status: int, content: object) -> None:
        self._send(status, json.dumps(content), "application/json")

    def _send(self, status: int, text: str, kind: str) -> None:
        body = text.encode()
        self.send_response(status)
        headers = {"Content-Type": kind, "Content-Length": str(len(body)), "Cache-Control": "no-store"}
        for name, value in (headers | {"Content-Security-Policy": _POLICY}).items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)
