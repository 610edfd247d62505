"""The gate before every page: who may ask, how much, and what an answer may load."""

import secrets
from typing import TYPE_CHECKING
from urllib.parse import parse_qs

from starlette.requests import cookie_parser

from stepblocks.errors import PipelineError
from stepblocks.files.page_policy import comes_from_this_machine
from stepblocks.window import texts

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

LARGEST_UPLOAD = 256_000_000  # of a file [bytes]
MOST_FILES = 20_000  # of an archive or a folder
_MEGABYTE = 1_000_000  # [bytes]
_LARGEST_REQUEST = 1_000_000  # of anything else [bytes]
_LONGEST_LENGTH = 12  # digits of the length of a request
_UPLOADS = "/upload/"  # in the path of what takes a file

# The framework compiles its pages in the browser. Nothing is loaded from elsewhere.
_POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; base-uri 'self'; "
    "form-action 'none'; frame-ancestors 'none'; object-src 'none'"
)
# A file of the folder may hold a script: it runs in a place of its own, without the cookie
_POLICY_OF_FILES = (
    "sandbox allow-scripts; default-src 'self' 'unsafe-inline' data: blob:; "
    "connect-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
_HEADERS = {"X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer"}


class Gate:
    """Let through what comes from this window alone: host, origin, token, length.

    The address that is opened first carries the token. It is answered with a cookie, which no
    other site can send, and with the address without it.

    Parameters
    ----------
    app : ASGI application
        What is behind the gate.
    port : int
        Where the window is served.
    token : str
        What only its user knows.
    files : str
        Path, not to be guessed either, below which the files of the folder are read without the
        cookie: a report runs in a place of its own, from which no cookie is sent for its pictures.
    """

    def __init__(self, app: "ASGIApp", port: int, token: str, files: str) -> None:
        self._app = app
        self._port = port
        self._token = token
        self._files = files
        self._cookie = f"stepblocks-{port}"  # a browser keeps cookies by machine, not by port

    async def __call__(self, scope: "Scope", receive: "Receive", send: "Send") -> None:
        """Answer a request, or hand it on."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = _read_headers(scope)
        if not comes_from_this_machine(
            headers.get("host", []), headers.get("origin", []), self._port
        ):
            await _answer_refusal(scope, send, 403, texts.REFUSED_HOST)
            return
        if self._is_for_token_address(scope):
            await self._answer_with_cookie(send)
            return
        is_file = self._asks_for_file(scope)
        if not is_file and not self._has_cookie(headers):
            await _answer_refusal(scope, send, 403, texts.REFUSED_TOKEN)
            return
        fault = _find_length_refusal(scope, headers)
        if fault is not None:
            await _answer_refusal(scope, send, *fault)
            return
        policy = _POLICY_OF_FILES if is_file else _POLICY
        client = _Client(receive)
        try:
            await self._app(scope, client.receive, _wrap_send_with_policy(send, policy))
        except RuntimeError:
            if not client.is_gone:  # else nobody waits for the answer any more
                raise

    def _is_for_token_address(self, scope: "Scope") -> bool:
        """Tell whether a request is for the address with the token."""
        if scope["type"] != "http" or scope["method"] != "GET" or scope["path"] != "/":
            return False
        tokens = parse_qs(scope["query_string"].decode("latin-1")).get("token", [])
        return len(tokens) == 1 and self._is_token(tokens[0])

    def _asks_for_file(self, scope: "Scope") -> bool:
        """Tell whether a request reads a file of the folder."""
        if scope["type"] != "http" or scope["method"] != "GET":
            return False
        begin = scope["path"][: len(self._files)]
        return secrets.compare_digest(begin.encode(), self._files.encode())

    def _is_token(self, text: str) -> bool:
        """Compare in a time that tells nothing."""
        return secrets.compare_digest(text.encode(), self._token.encode())

    def _has_cookie(self, headers: dict[str, list[str]]) -> bool:
        """Tell whether a request has the token of this window as its cookie."""
        # cookies of another server of this machine come along, whatever they are
        cookies = cookie_parser("; ".join(headers.get("cookie", [])))
        return self._is_token(cookies.get(self._cookie, ""))

    async def _answer_with_cookie(self, send: "Send") -> None:
        """Answer with the cookie, and with the address that shows no token."""
        cookie = f"{self._cookie}={self._token}; Path=/; HttpOnly; SameSite=Strict"
        headers = {"Location": "/", "Set-Cookie": cookie, "Cache-Control": "no-store"}
        await _answer_with_text(send, 303, "", headers)


class _Client:
    """Who asks, who may go before the answer is there."""

    def __init__(self, receive: "Receive") -> None:
        self._receive = receive
        self.is_gone = False

    async def receive(self) -> "Message":
        """Return the next message of a request."""
        message = await self._receive()
        if message["type"] == "http.disconnect":
            self.is_gone = True
        return message


def make_size_error() -> PipelineError:
    """Make the error of a file that is too large to be handed in."""
    return PipelineError(texts.FILE_TOO_LARGE.format(most=LARGEST_UPLOAD // _MEGABYTE))


def _read_headers(scope: "Scope") -> dict[str, list[str]]:
    """Return every value of each header of a request, by its name in small letters."""
    headers: dict[str, list[str]] = {}
    for name, value in scope["headers"]:
        headers.setdefault(name.decode("latin-1").lower(), []).append(value.decode("latin-1"))
    return headers


def _find_length_refusal(scope: "Scope", headers: dict[str, list[str]]) -> tuple[int, str] | None:
    """Return status and reason where a request is too long or does not say how long it is."""
    if scope["type"] == "websocket":  # the framework bounds each message
        return None
    unsaid = ["0"] if scope["method"] in ("GET", "HEAD") else []
    lengths = headers.get("content-length", unsaid)
    if "transfer-encoding" in headers or len(lengths) != 1 or not lengths[0].isdecimal():
        return 411, texts.REFUSED_LENGTH
    largest = _LARGEST_REQUEST
    if _UPLOADS in scope["path"]:
        largest = LARGEST_UPLOAD
    if len(lengths[0]) > _LONGEST_LENGTH or int(lengths[0]) > largest:
        return 413, texts.REFUSED_SIZE.format(most=largest)
    return None


def _wrap_send_with_policy(send: "Send", policy: str) -> "Send":
    """Return a way to answer that adds a policy to every answer."""
    added = {**_HEADERS, "Content-Security-Policy": policy}

    async def send_with_policy(message: "Message") -> None:
        if message["type"] == "http.response.start":
            headers = list(message.get("headers", []))
            headers += _encode_headers(added)
            message = {**message, "headers": headers}
        await send(message)

    return send_with_policy


async def _answer_refusal(scope: "Scope", send: "Send", status: int, reason: str) -> None:
    """Answer a request that is not let through."""
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008})
        return
    await _answer_with_text(
        send, status, reason, {"Cache-Control": "no-store", "Connection": "close"}
    )


async def _answer_with_text(send: "Send", status: int, text: str, headers: dict[str, str]) -> None:
    """Answer with a text."""
    body = text.encode()
    all_headers = {
        "Content-Type": "text/plain; charset=utf-8",
        "Content-Length": str(len(body)),
        "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
        **_HEADERS,
        **headers,
    }
    encoded = _encode_headers(all_headers)
    await send({"type": "http.response.start", "status": status, "headers": encoded})
    await send({"type": "http.response.body", "body": body})


def _encode_headers(headers: dict[str, str]) -> list[tuple[bytes, bytes]]:
    """Return headers as a server sends them."""
    return [(name.lower().encode(), value.encode("latin-1")) for name, value in headers.items()]
