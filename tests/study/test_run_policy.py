"""The server of `study run` keeps its policy: each rule is broken by a request, or from the page.

The rules stand in `stepblocks.study.conduct.server`: host, origin, token, length, size, rate, and
what the page may load, run and be framed by.
"""

import json
import re
import socket
import struct
import threading
import types

import pytest

from oracles.browser import browser
from oracles.page_policy import ATTEMPTS, TRY, counting_server
from stepblocks.study.conduct.run import open_run
from stepblocks.study.conduct.server import RunServer, _Handler
from stepblocks.study.run import design_study


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    design_study((20e-6, 50e-6), folder, seed=1, participants=1, repetitions=1, probes=("a", "b"))
    found = RunServer(open_run(folder, "1"))
    threading.Thread(target=found.serve_until_done, daemon=True).start()
    yield found
    found.shutdown()


def send(server, *lines, body=b""):
    """All that the server answers to these very bytes until it hangs up, or is silent for 2 s."""
    with socket.create_connection(("127.0.0.1", server.server_port), timeout=10) as line:
        line.sendall("\r\n".join((*lines, "", "")).encode() + body)
        line.settimeout(2.0)
        answer = b""
        try:
            while part := line.recv(1 << 16):
                answer += part
        except TimeoutError:
            pass
        return answer


def statuses(answer):
    return [int(one) for one in re.findall(rb"HTTP/1\.1 (\d+) ", answer)]


def host(server, name="127.0.0.1"):
    return f"Host: {name}:{server.server_port}"


def close(server, *lines):
    """A request after which the connection ends."""
    return statuses(send(server, *lines, "Connection: close"))


@pytest.mark.parametrize(
    "named",
    [
        (),
        ("Host:",),
        ("Host: 127.0.0.1",),
        ("Host: localhost:80",),
        ("Host: 127.0.0.1:{port}.evil.example",),
        ("Host: [::1]:{port}",),
        ("Host: evil.example:{port}",),
        # of two, what stands between may believe the other
        ("Host: 127.0.0.1:{port}", "Host: evil.example:{port}"),
        ("Host: 127.0.0.1:{port}", "host: 127.0.0.1:{port}"),
    ],
)
def test_who_names_another_host_learns_nothing_not_even_the_state(server, named):
    # a name that a foreign page lets point at this machine must not open it (DNS rebinding)
    lines = [one.format(port=server.server_port) for one in named]
    for path in ("/", "/state", "/nowhere"):
        answer = send(server, f"GET {path} HTTP/1.1", *lines)
        assert statuses(answer) == [403]
        assert b"condition" not in answer
        assert server.token.encode() not in answer
    assert close(server, "GET /state HTTP/1.1", host(server, "localhost")) == [200]


@pytest.mark.parametrize("origin", ["null", "http://evil.example", "https://127.0.0.1:{port}", ""])
@pytest.mark.parametrize("method", ["GET", "POST"])
@pytest.mark.parametrize("before", [(), ("Origin: http://127.0.0.1:{port}",)])
def test_a_request_of_another_page_is_refused_whatever_it_asks(server, method, origin, before):
    # the origin of the page before that of another does not help it
    origins = [one.format(port=server.server_port) for one in (*before, f"Origin: {origin}")]
    lines = host(server), *origins, "Content-Length: 2" if method == "POST" else "Accept: */*"
    token = f"X-Stepblocks: {server.token}"
    refused = send(server, f"{method} /state HTTP/1.1", *lines, token, body=b"{}")
    assert statuses(refused) == [403]


@pytest.mark.parametrize(
    "length",
    [
        (),
        ("Transfer-Encoding: chunked",),
        ("Transfer-Encoding: chunked", "Content-Length: 2"),  # which of the two is believed?
        ("Content-Length: 1e3",),
    ],
)
def test_a_request_that_does_not_say_its_length_is_refused(server, length):
    lines = host(server), f"X-Stepblocks: {server.token}", *length
    assert statuses(send(server, "POST /begin HTTP/1.1", *lines, body=b"2\r\n{}\r\n")) == [411]


@pytest.mark.repeats
@pytest.mark.parametrize(
    ("size", "status"),
    [
        ("20000", 200),
        ("20001", 413),
        (f"{10**30}", 413),
        ("0000000000000020001", 413),  # zeros before it make it no smaller
        ("9" * 5000, 413),  # more digits than Python turns into a number
    ],
)
def test_a_request_has_at_most_20_000_bytes(server, size, status):
    lines = host(server), f"X-Stepblocks: {server.token}", f"Content-Length: {size}"
    body = b"{}".ljust(20_000)
    assert statuses(send(server, "POST /begin HTTP/1.1", *lines, body=body)) == [status]


def test_what_follows_a_refused_request_on_its_line_is_no_request(server):
    # a body that nobody read would else be taken for the next request (request smuggling)
    inner = f"GET /state HTTP/1.1\r\n{host(server)}\r\n\r\n".encode()
    lines = host(server), "X-Stepblocks: guess", f"Content-Length: {len(inner)}"
    assert statuses(send(server, "POST /begin HTTP/1.1", *lines, body=inner)) == [403]


@pytest.mark.parametrize(
    ("lines", "status"),
    [
        (("Content-Length: {size}",), 413),  # a GET has no body
        (("Content-Length: 0", "Content-Length: {size}"), 403),  # which of the two is believed?
        (("no header", "Content-Length: {size}"), 403),  # the library reads no header after it
    ],
)
def test_a_get_with_a_body_has_one_answer_and_its_line_is_cut(server, lines, status):
    # else the body is taken for the next request (request smuggling, RFC 9112, 11.2)
    inner = f"GET /state HTTP/1.1\r\n{host(server)}\r\n\r\n".encode()
    lines = [one.format(size=len(inner)) for one in lines]
    answer = send(server, "GET /state HTTP/1.1", host(server), *lines, body=inner)
    assert statuses(answer) == [status]
    assert b"Connection: close" in answer
    assert close(server, "GET / HTTP/1.1", host(server), "Content-Length: 0") == [200]


def post(server, path, body):
    """The answer to what the page asks, with its token."""
    lines = host(server), f"X-Stepblocks: {server.token}", f"Content-Length: {len(body)}"
    return send(server, f"POST {path} HTTP/1.1", *lines, "Connection: close", body=body)


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("/begin", b"[" * 9_000),  # deeper than Python's stack
        ("/begin", b'{"a":' * 3_000),
        ("/begin", b"[]"),
        ("/begin", b"\xff"),
        ("/answer", b'{"trial": "1", "answers": [], "reaction_s": 1}'),
        # beyond the largest double, 1.8e308 (IEEE 754)
        ("/answer", b'{"trial": "1", "answers": {}, "reaction_s": 1%s}' % (b"0" * 400)),
        ("/answer", b'{"trial": "1", "answers": {}, "reaction_s": NaN}'),  # no JSON (RFC 8259, 6)
    ],
)
def test_what_is_no_request_of_the_page_is_answered_and_prints_nothing(server, path, body, capfd):
    assert statuses(post(server, path, body)) == [400]
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("x", ["1" + "0" * 400, "NaN", "-Infinity"])
def test_a_hand_that_is_nowhere_is_refused_and_does_not_move(server, x, monkeypatch):
    places = []
    monkeypatch.setattr(server.experiment, "move", lambda x, held: places.append(x))
    assert statuses(post(server, "/hand", f'{{"x": {x}, "held": true}}'.encode())) == [400]
    assert statuses(post(server, "/hand", b'{"x": 1e999, "held": true}')) == [200]
    assert places == [1.0]  # the end of the screen


@pytest.mark.parametrize("seconds", ["1e300", "1e999", "86400.5", "-1"])
def test_a_reaction_of_more_than_a_day_is_refused_and_not_written(server, seconds):
    body = f'{{"trial": "1", "answers": {{"estimate_um": "30"}}, "reaction_s": {seconds}}}'
    answer = post(server, "/answer", body.encode())
    assert statuses(answer) == [422]
    assert b"reaction_s must be from 0 to 86400, got" in answer
    assert not server.experiment.path.exists()


@pytest.mark.parametrize(
    ("first", "lines", "status"),
    [
        ("PUT / HTTP/1.1", (), 501),
        ("HEAD / HTTP/1.1", (), 501),
        ("OPTIONS * HTTP/1.1", (), 501),
        ("GET / HTTP/1.1", ("A: b",) * 101, 431),
        ("GET / HTTP/2.0", (), 505),
        ("GET / HTTP/x", (), 400),
        ("<script>alert(1)</script>", (), 400),
        ("GET /", (), 403),  # of 1991, without headers; no browser asks so
        (None, (), 414),
    ],
)
def test_what_the_library_refuses_is_answered_as_all_else(server, first, lines, status):
    if first is None:  # a longer line is not read to its end
        with socket.create_connection(("127.0.0.1", server.server_port), timeout=10) as line:
            line.sendall(b"G" * 65_537)
            answer = b"".join(iter(lambda: line.recv(1 << 16), b""))
    else:
        answer = send(server, first, *lines)
    assert statuses(answer) == [status]
    head, _, body = answer.partition(b"\r\n\r\n")
    found = dict(line.split(": ", 1) for line in head.decode().split("\r\n")[1:])
    assert found["Content-Type"] == "application/json"
    assert found["X-Content-Type-Options"] == "nosniff"
    assert found["Cache-Control"] == "no-store"
    assert found["Content-Security-Policy"].startswith("default-src 'none'")
    assert found["Connection"] == "close"
    if first == "HEAD / HTTP/1.1":
        assert body == b""  # RFC 9110, 9.3.2
    else:
        assert list(json.loads(body)) == ["error"]
        assert int(found["Content-Length"]) == len(body)


def test_the_401st_request_of_a_second_is_refused_and_the_next_second_is_free(server, monkeypatch):
    now = [10.0]
    clock = types.SimpleNamespace(monotonic=lambda: now[0])
    monkeypatch.setattr("stepblocks.study.conduct.server.time", clock)
    request = f"GET /state HTTP/1.1\r\n{host(server)}\r\n\r\n"
    many = request.encode() * 401
    answer = send(server, request.strip(), body=many)
    assert statuses(answer) == [200] * 400 + [429]
    now[0] = 11.0
    assert close(server, "GET /state HTTP/1.1", host(server)) == [200]


def test_every_answer_forbids_to_keep_guess_or_tell_it_refusals_too(server):
    for lines in (("GET / HTTP/1.1", host(server), "Connection: close"), ("GET / HTTP/1.1",)):
        head, _, body = send(server, *lines).partition(b"\r\n\r\n")
        found = dict(line.split(": ", 1) for line in head.decode().split("\r\n")[1:])
        assert found["X-Content-Type-Options"] == "nosniff"
        assert found["Referrer-Policy"] == "no-referrer"
        assert found["Cache-Control"] == "no-store"
        assert found["Connection"] == "close"
        policy = dict(rule.split(" ", 1) for rule in found["Content-Security-Policy"].split("; "))
        assert policy["default-src"] == policy["base-uri"] == policy["form-action"] == "'none'"
        assert policy["frame-ancestors"] == "'none'"
        assert policy["connect-src"] == "'self'"
        assert policy["script-src"] == f"'nonce-{server.nonce}'"
    assert json.loads(body) == {"error": "only the page of this run may ask this"}


@pytest.fixture(scope="module")
def window(tmp_path_factory):
    with browser(f"user-data-dir={tmp_path_factory.mktemp('profile')}") as found:
        if found is None:
            pytest.skip("no chromium with chromedriver")
        found.set_script_timeout(60)
        yield found


@pytest.fixture(scope="module")
def there():
    with counting_server() as found:
        yield found


@pytest.mark.browser
@pytest.mark.parametrize("name", ATTEMPTS)
def test_what_breaks_a_rule_from_within_the_page_is_stopped_and_reaches_nobody(
    name, server, there, window
):
    attempt, rule = ATTEMPTS[name]
    place, asked = there
    asked.clear()
    window.get(server.url)
    broken, taken = window.execute_async_script(TRY.replace("ATTEMPT", attempt), place)
    assert broken[0].startswith(rule)
    assert not taken
    assert asked == []
    assert window.current_url == server.url


@pytest.mark.browser
def test_the_page_of_a_run_stands_in_no_frame_of_another(server, window):
    with counting_server(f'<iframe src="{server.url}"></iframe><p>outer</p>') as (outer, _):
        window.get(outer)
        window.switch_to.frame(0)
        assert server.token not in window.page_source
        assert "participant" not in window.page_source


def test_a_client_that_says_nothing_is_cut_off_and_keeps_nobody_waiting(server, monkeypatch):
    # 30 s of silence, here half of one; a request of which half comes is as silent
    assert 1.0 < _Handler.timeout <= 60.0
    monkeypatch.setattr(_Handler, "timeout", 0.5)
    half = (
        f"POST /begin HTTP/1.1\r\n{host(server)}\r\nX-Stepblocks: {server.token}\r\n"
        "Content-Length: 100\r\n\r\n{"
    )
    for said in (b"", half.encode()):
        with socket.create_connection(("127.0.0.1", server.server_port), timeout=10) as silent:
            silent.sendall(said)
            assert close(server, "GET /state HTTP/1.1", host(server)) == [200]
            assert silent.recv(1 << 16) == b""  # hung up; an endless wait would end in an error


def test_a_client_that_hangs_up_in_the_middle_of_an_answer_prints_nothing(server, capfd):
    others = threading.enumerate()  # lines of the browser among them, which last for 30 s
    for _ in range(5):
        line = socket.create_connection(("127.0.0.1", server.server_port), timeout=10)
        line.sendall(f"GET / HTTP/1.1\r\n{host(server)}\r\n\r\n".encode() * 20)
        # closed at once, with a reset: what the server still writes meets nobody
        line.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        line.close()
    assert close(server, "GET /state HTTP/1.1", host(server)) in ([200], [429])
    for thread in threading.enumerate():
        if thread not in others:
            thread.join(timeout=5.0)
    assert capfd.readouterr().err == ""
