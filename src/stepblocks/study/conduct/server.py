"""The page of one run: what it may ask, and the policy that every request must keep."""

import json
import math
import secrets
import sys
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from stepblocks.errors import StepblocksError
from stepblocks.files.pages import render_page
from stepblocks.haptics.hands import Mouse
from stepblocks.haptics.servo import raise_priority
from stepblocks.study.conduct.run import Run

_LARGEST = {"GET": 0, "POST": 20_000}  # bytes of a request
_MOST_REQUESTS = 400  # of the page in one second; it asks 60 times
_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'nonce-{}'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


class RunServer(ThreadingHTTPServer):
    """Serves one run until it is done; `url` is where."""

    daemon_threads = True

    def __init__(self, run: Run, port: int = 0) -> None:
        super().__init__(("127.0.0.1", port), _Handler)
        self.experiment = run
        self.token = secrets.token_urlsafe(16)
        self.nonce = secrets.token_urlsafe(16)
        self.url = f"http://127.0.0.1:{self.server_port}/"
        self._second, self._asked = 0, 0

    def is_too_busy(self) -> bool:
        """Count a request; whether there were more in this second than a page asks."""
        second = int(time.monotonic())
        self._asked = self._asked + 1 if second == self._second else 1
        self._second = second
        return self._asked > _MOST_REQUESTS

    def until_done(self) -> None:
        """Serve until the last answer is given."""
        if self.experiment.virtual and not raise_priority(10):
            print(
                "stepblocks: this system grants no real-time priority: ticks of the force may come "
                "late; each is recorded with its lateness",
                file=sys.stderr,
            )
        try:
            self.serve_forever(poll_interval=0.1)
        finally:
            self.server_close()
            self.experiment.close()


class _Handler(BaseHTTPRequestHandler):
    # Answers the page of a run and nobody else
    # The policy: requests name this machine and port as their host; one that changes something
    # comes from this page (origin and token); all are small and not too many; the page loads
    # nothing, runs its own script only, and stands in no frame.
    server: RunServer
    protocol_version = "HTTP/1.1"
    default_request_version = "HTTP/1.1"  # of an answer to what is no request: it has headers too
    timeout = 30.0  # s of silence until a line is cut; a page opens a new one by itself

    def log_message(self, format: str, *args: object) -> None:
        """Write nothing: the terminal is the experimenter's."""

    def handle(self) -> None:
        with suppress(ConnectionError):  # who closes the page in the middle of an answer wants none
            super().handle()

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        # A refusal, of the library too, is answered as all else is, and the line is cut
        self.close_connection = True
        self._send_json(code, {"error": message or self.responses[code][0]})

    def do_GET(self) -> None:
        run = self.server.experiment
        if not self._is_allowed():
            return
        if self.path == "/":
            self._send(
                200,
                render_page(
                    "stepblocks.study",
                    "run.html",
                    # 400 pixels to the right of the edge are there on every screen
                    metres=max(1e-4, 1.2 * run.reach / 400.0),
                    participant=run.participant,
                    virtual=run.virtual,
                    token=self.server.token,
                    nonce=self.server.nonce,
                ),
                "text/html; charset=utf-8",
            )
        elif self.path == "/state":
            self._send_json(200, run.state())
        else:
            self._send_json(404, {"error": "there is nothing here"})

    def do_POST(self) -> None:
        if not self._is_allowed():
            return
        try:
            # `int` refuses the words NaN and Infinity, which are no JSON
            asked = json.loads(
                self.rfile.read(int(self.headers["Content-Length"])), parse_constant=int
            )
            if not isinstance(asked, dict):
                raise ValueError("a JSON object is expected")
            found = self._perform(self.server.experiment, asked)
            self._send_json(
                200 if found is not None else 404, found or {"error": "nothing is here"}
            )
        except StepblocksError as error:
            self._send_json(422, {"error": str(error)})
        except (
            ValueError,
            KeyError,
            TypeError,
            AttributeError,
            OverflowError,  # a whole number of hundreds of digits
            RecursionError,  # thousands of brackets
        ):
            self._send_json(400, {"error": "the request is not one of this page"})

    def _perform(self, run: Run, asked: Mapping[str, Any]) -> dict[str, object] | None:
        # Do what the page asks; None for what it cannot ask
        if self.path == "/hand":
            if isinstance(run.hand, Mouse):
                run.hand.post(min(max(float(asked["x"]), -1.0), 1.0), bool(asked["held"]))
            return run.sense()
        acts = {"/begin": run.begin, "/undo": run.undo}
        if self.path in acts:
            acts[self.path]()
        elif self.path == "/answer":
            run.answer(
                str(asked["trial"]),
                {str(name): str(text) for name, text in asked["answers"].items()},
                float(asked.get("reaction_s", math.nan)),
                str(asked.get("comment", "")),
            )
            if run.now is None:
                # the page still shows that the run is done
                threading.Timer(1.5, self.server.shutdown).start()
        else:
            return None
        return run.state()

    def _is_allowed(self) -> bool:
        # Whether a request keeps the policy; one that does not is answered and cut off
        hosts = [f"{name}:{self.server.server_port}" for name in ("127.0.0.1", "localhost")]
        host, origin = self.headers.get("Host", ""), self.headers.get("Origin")
        size = self.headers.get("Content-Length", "0" if self.command == "GET" else "")
        ours = self.command == "GET" or secrets.compare_digest(
            self.headers.get("X-Stepblocks", "").encode(), self.server.token.encode()
        )
        # of a header that comes twice, or after a line that is none, another reader sees another
        clear = not self.headers.defects and all(
            len(self.headers.get_all(name, ())) <= 1
            for name in ("Host", "Origin", "Content-Length")
        )
        if host not in hosts or origin not in (None, f"http://{host}") or not ours or not clear:
            self.send_error(403, "only the page of this run may ask this")
        elif not size.isdecimal() or self.headers.get("Transfer-Encoding"):
            self.send_error(411, "a request must say its length")
        elif len(size) > 12 or int(size) > _LARGEST[self.command]:
            self.send_error(413, f"a request must have at most {_LARGEST[self.command]} bytes")
        elif self.server.is_too_busy():
            self.send_error(429, f"at most {_MOST_REQUESTS} requests in a second are answered")
        else:
            return True
        return False

    def _send_json(self, status: int, content: object) -> None:
        self._send(status, json.dumps(content), "application/json")

    def _send(self, status: int, text: str, kind: str) -> None:
        body = text.encode()
        self.send_response(status)
        headers = {
            "Content-Type": kind,
            "Content-Length": str(len(body)),
            "Cache-Control": "no-store",
            "Content-Security-Policy": _POLICY.format(self.server.nonce),
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "Connection": "close" if self.close_connection else "keep-alive",
        }
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(b"" if self.command == "HEAD" else body)
