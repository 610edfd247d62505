"""The page of one run: what it may ask, and the policy that every request must keep."""

import json
import math
import secrets
import sys
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from stepblocks.errors import StepblocksError
from stepblocks.files.page_policy import comes_from_this_machine
from stepblocks.files.pages import render_page
from stepblocks.haptics.servo import request_real_time_priority
from stepblocks.study.conduct.page_run import PageRun

_LARGEST = {"GET": 0, "POST": 20_000}  # bytes of a request
_LONGEST_LENGTH = 12  # digits of the length of a request
_MOST_REQUESTS = 400  # of the page in one second; it asks 60 times
_PRIORITY = 10  # of the process with a servo loop
_SHOWS_END = 1.5  # time in which the page asks once more, and shows that the run is done [s]
_FARTHEST = 1.0  # of the mouse from the middle of the page [m]

# Size of a pixel: 400 pixels to the right of the edge are there on every screen
_PIXELS = 400.0
_SMALLEST_REACH = 1e-4  # of a hand [m]
_MARGIN = 1.2  # of the page over the reach of a hand

_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'nonce-{}'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


class RunServer(ThreadingHTTPServer):
    """Serves one run until it is done; `url` is where."""

    daemon_threads = True

    def __init__(self, run: PageRun, port: int = 0) -> None:
        super().__init__(("127.0.0.1", port), _Handler)
        self.experiment = run
        self.token = secrets.token_urlsafe(16)
        self.nonce = secrets.token_urlsafe(16)
        self.url = f"http://127.0.0.1:{self.server_port}/"
        self._second = 0
        self._requests = 0  # in that second

    def count_request_and_check_limit(self) -> bool:
        """Count a request; return whether there are too many in this second."""
        second = int(time.monotonic())
        if second != self._second:
            self._requests = 0
        self._second = second
        self._requests += 1
        return self._requests > _MOST_REQUESTS

    def serve_until_done(self) -> None:
        """Serve until the last answer is given."""
        if self.experiment.virtual and not request_real_time_priority(_PRIORITY):
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


@dataclass(frozen=True)
class _MouseRequest:
    """Where the page says that the mouse is [m], and whether it is held."""

    x: float
    held: bool

    @classmethod
    def parse(cls, document: Mapping[str, Any]) -> "_MouseRequest":
        """Read a request; refuse one that is not of the page."""
        x = float(document["x"])
        return cls(min(max(x, -_FARTHEST), _FARTHEST), bool(document["held"]))


@dataclass(frozen=True)
class _AnswerRequest:
    """The answer to a trial, as `Run.answer` takes it."""

    trial: str
    texts: Mapping[str, str]
    reaction: float
    comment: str

    @classmethod
    def parse(cls, document: Mapping[str, Any]) -> "_AnswerRequest":
        """Read a request; refuse one that is not of the page."""
        texts = {str(name): str(text) for name, text in document["answers"].items()}
        return cls(
            str(document["trial"]),
            texts,
            float(document.get("reaction_s", math.nan)),
            str(document.get("comment", "")),
        )


class _Handler(BaseHTTPRequestHandler):
    """Serve the page of a run, and nothing else.

    The policy: requests name this machine and port as their host; one that changes something
    comes from this page (origin and token); all are small and not too many; the page loads
    nothing, runs its own script only, and stands in no frame.
    """

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
        """Send an error as JSON, those of the library too, and close the connection."""
        self.close_connection = True
        if message is None:
            message, _ = self.responses[code]
        self._send_json(code, {"error": message})

    def do_GET(self) -> None:
        if not self._check_policy_or_send_error():
            return
        if self.path == "/":
            self._send_text(200, self._render_run_page(), "text/html; charset=utf-8")
        elif self.path == "/state":
            self._send_json(200, self.server.experiment.state())
        else:
            self._send_json(404, {"error": "there is nothing here"})

    def _render_run_page(self) -> str:
        """Return the page of the run."""
        run = self.server.experiment
        return render_page(
            "stepblocks.study",
            "run.html",
            metres=max(_SMALLEST_REACH, _MARGIN * run.reach / _PIXELS),
            participant=run.participant,
            virtual=run.virtual,
            token=self.server.token,
            nonce=self.server.nonce,
        )

    def do_POST(self) -> None:
        if not self._check_policy_or_send_error():
            return
        try:
            state = self._perform_request(self.server.experiment, self._read_document())
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
        else:
            if state is None:
                self._send_json(404, {"error": "nothing is here"})
            else:
                self._send_json(200, state)

    def _read_document(self) -> dict[str, Any]:
        """Read the JSON object of a request."""
        length = int(self.headers["Content-Length"])
        # `int` refuses the words NaN and Infinity, which are no JSON
        document = json.loads(self.rfile.read(length), parse_constant=int)
        if not isinstance(document, dict):
            raise ValueError("a JSON object is expected")
        return document

    def _perform_request(
        self, run: PageRun, document: Mapping[str, Any]
    ) -> dict[str, object] | None:
        """Carry out a request and return the new state; None for an unknown request."""
        if self.path == "/hand":
            mouse = _MouseRequest.parse(document)
            run.move(mouse.x, mouse.held)
            return run.report_probe_state()
        if self.path == "/begin":
            run.begin()
        elif self.path == "/undo":
            run.undo()
        elif self.path == "/answer":
            answer = _AnswerRequest.parse(document)
            run.answer(answer.trial, answer.texts, answer.reaction, answer.comment)
            if run.now is None:
                threading.Timer(_SHOWS_END, self.server.shutdown).start()
        else:
            return None
        return run.state()

    def _check_policy_or_send_error(self) -> bool:
        """Return whether a request meets the policy; send an error if it does not."""
        length = self._get_stated_length()
        if not self._is_from_page():
            self.send_error(403, "only the page of this run may ask this")
        elif not length.isdecimal() or self.headers.get("Transfer-Encoding"):
            self.send_error(411, "a request must say its length")
        elif len(length) > _LONGEST_LENGTH or int(length) > _LARGEST[self.command]:
            self.send_error(413, f"a request must have at most {_LARGEST[self.command]} bytes")
        elif self.server.count_request_and_check_limit():
            self.send_error(429, f"at most {_MOST_REQUESTS} requests in a second are answered")
        else:
            return True
        return False

    def _get_stated_length(self) -> str:
        """Return the stated length of a request; a GET need not state one."""
        unsaid = "0" if self.command == "GET" else ""
        return str(self.headers.get("Content-Length", unsaid))

    def _is_from_page(self) -> bool:
        """Return whether host, origin and token are those of the page, without doubt."""
        hosts = self.headers.get_all("Host", [])
        origins = self.headers.get_all("Origin", [])
        if not comes_from_this_machine(hosts, origins, self.server.server_port):
            return False
        if self.command != "GET" and not self._has_token():
            return False
        # of a header that comes twice, or after a line that is none, another reader sees another
        return not self.headers.defects and len(self.headers.get_all("Content-Length", ())) <= 1

    def _has_token(self) -> bool:
        """Return whether a request has the token of the page."""
        token = self.headers.get("X-Stepblocks", "")
        return secrets.compare_digest(token.encode(), self.server.token.encode())

    def _send_json(self, status: int, content: object) -> None:
        """Answer with a JSON document."""
        self._send_text(status, json.dumps(content), "application/json")

    def _send_text(self, status: int, text: str, media_type: str) -> None:
        """Answer with a text of a media type."""
        body = text.encode()
        connection = "close" if self.close_connection else "keep-alive"
        self.send_response(status)
        headers = {
            "Content-Type": media_type,
            "Content-Length": str(len(body)),
            "Cache-Control": "no-store",
            "Content-Security-Policy": _POLICY.format(self.server.nonce),
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "Connection": connection,
        }
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)
