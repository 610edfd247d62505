"""The window answers its own user alone, and with nothing from outside its folder.

A window runs as a process of its own and is asked by plain HTTP, as a stranger would.
"""

import http.client
import os
import re
import subprocess
import sys

import pytest

pytest.importorskip("nicegui")

SECRET = "of another folder"


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    """Port and token of a window on a folder with a file, beside which another lies."""
    base = tmp_path_factory.mktemp("beside")
    folder = base / "lab"
    folder.mkdir()
    (base / "secret.txt").write_text(SECRET)
    (folder / "mine.toml").write_text('[[step_block]]\nid = "a"\nheight = "25 um"\n')
    (folder / "page.html").write_text("<script>1</script>")
    (folder / ".hidden").write_text(SECRET)
    (folder / "out").mkdir()
    (folder / "out" / "manifest.json").write_text("{}")  # so that its page is linked
    if os.name == "posix":
        (folder / "link.txt").symlink_to(base / "secret.txt")
    words = [sys.executable, "-m", "stepblocks", "app", str(folder), "--no-open"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True, cwd=base) as process:
        try:
            line = process.stdout.readline()
            port, token = re.fullmatch(
                r"open http://127.0.0.1:(\d+)/\?token=(\S+)\n", line
            ).groups()
            yield int(port), token
        finally:
            process.terminate()
            process.communicate(timeout=60)
    assert sorted(path.name for path in base.iterdir()) == ["lab", "secret.txt"]


@pytest.fixture(scope="module")
def files(address):
    """Where the start page says that files of the folder are."""
    return re.search(r"/folder/[^/]{16,}/", ask(address, "/")[2])[0]


def ask(address, path, method="GET", body=None, *, own=True, **headers):
    """Status, headers and text of what a window answers; with the cookie of its user, or not."""
    port, token = address
    line = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    if own:
        headers.setdefault("Cookie", f"stepblocks-{port}={token}")
    line.request(method, path, body=body, headers=headers)
    answer = line.getresponse()
    found = answer.status, answer.headers, answer.read().decode(errors="replace")
    line.close()
    return found


def test_the_address_with_the_token_is_answered_with_a_cookie_that_no_other_site_sends(address):
    port, token = address
    status, headers, _ = ask(address, f"/?token={token}", own=False)
    assert status == 303
    assert headers["Location"] == "/"  # the token leaves the bar of the browser
    cookie = headers["Set-Cookie"]
    assert cookie.startswith(f"stepblocks-{port}={token};")
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    status, headers, text = ask(address, "/")
    assert status == 200
    assert token not in text
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert headers["X-Content-Type-Options"] == "nosniff"


@pytest.mark.parametrize(
    "path",
    [
        "/",
        "/?token=guess",
        "/?token=",
        "/nowhere",
        "/folder/mine.toml",
        "/_nicegui_ws/socket.io/?EIO=4&transport=polling",
        "/openapi.json",
    ],
)
@pytest.mark.parametrize(
    "cookie", [{}, {"Cookie": "stepblocks=guess"}, {"Cookie": ";;=a; stepblocks"}]
)
def test_a_second_user_without_the_token_gets_nothing(address, path, cookie):
    status, headers, text = ask(address, path, own=False, **cookie)
    assert status == 403
    assert "Set-Cookie" not in headers
    assert text == "open the address that the terminal shows: it carries the token of this window"


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "127.0.0.1"},
        {"Host": "evil.example:{port}"},
        {"Host": "127.0.0.1:{port}.evil.example"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "https://127.0.0.1:{port}"},
    ],
)
def test_a_foreign_host_or_page_gets_nothing_even_with_the_cookie(address, headers):
    port, token = address
    named = {name: value.format(port=port) for name, value in headers.items()}
    for path in ("/", f"/?token={token}", "/_nicegui_ws/socket.io/?EIO=4&transport=polling"):
        status, _, text = ask(address, path, **named)
        assert (status, text) == (403, "only this machine may ask this")


def test_a_websocket_is_refused_without_the_cookie_and_from_another_page(address):
    upgrade = {
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",  # RFC 6455, 1.3
    }
    path = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"
    assert ask(address, path, own=False, **upgrade)[0] == 403
    assert ask(address, path, **upgrade, Origin="http://evil.example")[0] == 403


@pytest.mark.parametrize(
    "name",
    [
        "../secret.txt",
        "%2e%2e/secret.txt",
        "..%2fsecret.txt",
        "a/../../secret.txt",
        "%2fetc%2fpasswd",
        "/etc/passwd",
        "..%5csecret.txt",
        "link.txt",
        ".hidden",
        "",
        "mine.toml%00",
        "nowhere.txt",
    ],
)
@pytest.mark.parametrize("own", [True, False])
def test_no_name_leads_out_of_the_folder(address, files, name, own):
    status, _, text = ask(address, f"{files}{name}", own=own)
    assert status in (404, 307)
    assert SECRET not in text
    assert "root:" not in text


def test_a_file_of_the_folder_is_served_in_a_place_without_the_cookie(address, files):
    """Its pictures are asked for without the cookie, too, by an address that is not guessed."""
    assert ask(address, f"{files}mine.toml")[2].startswith("[[step_block]]")
    assert ask(address, "/folder/mine.toml", own=False)[0] == 403
    assert ask(address, "/folder/guess/mine.toml", own=False)[0] == 403
    assert ask(address, f"{files}mine.toml", own=False, Host="evil.example")[0] == 403
    assert ask(address, f"{files}mine.toml", own=False, Origin="null")[0] == 403
    assert ask(address, f"{files}mine.toml", "POST", b"", own=False)[0] == 403
    status, headers, _ = ask(address, f"{files}page.html", own=False)
    assert status == 200
    policy = headers["Content-Security-Policy"]
    assert policy.startswith("sandbox allow-scripts")
    assert "allow-same-origin" not in policy
    assert "connect-src 'none'" in policy


@pytest.mark.parametrize(
    ("path", "length", "status"),
    [
        ("/", "1000001", 413),
        ("/_nicegui/client/x/upload/1", "256000001", 413),
        ("/", "9" * 5000, 413),
        ("/", "1e3", 411),
    ],
)
def test_a_request_is_bounded(address, path, length, status):
    port, token = address
    line = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    line.putrequest("POST", path)
    line.putheader("Cookie", f"stepblocks-{port}={token}")
    line.putheader("Content-Length", length)
    line.endheaders()
    found = line.getresponse().status
    line.close()
    assert found in (status, 400)  # the server may refuse a length that is none before the gate


def test_a_request_that_does_not_say_its_length_is_refused(address):
    port, token = address
    line = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    cookie = {"Cookie": f"stepblocks-{port}={token}"}
    line.request("POST", "/", body=iter([b"{}"]), headers=cookie, encode_chunked=True)
    assert line.getresponse().status == 411
    line.close()


def test_a_port_that_is_taken_and_a_folder_that_is_none_are_one_line(address, tmp_path):
    port, _ = address
    for words, message in (
        ([str(tmp_path), "--port", str(port)], f"error: port must be free, got {port}"),
        ([str(tmp_path / "none")], "error: folder must be there, got none"),
    ):
        done = subprocess.run(
            [sys.executable, "-m", "stepblocks", "app", *words, "--no-open"],
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 2
        assert done.stderr.startswith(f"stepblocks: {message}")
        assert "Traceback" not in done.stderr


def test_without_the_extra_the_command_names_it(tmp_path):
    """A folder before the installed packages hides the framework, as where it is not installed."""
    (tmp_path / "nicegui.py").write_text("raise ModuleNotFoundError('none', name='nicegui')")
    done = subprocess.run(
        [sys.executable, "-m", "stepblocks", "app", "--no-open"],
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr == (
        "stepblocks: error: the window needs nicegui: install the extra with pip install "
        "'stepblocks[app]'\n"
    )


def test_every_script_and_font_comes_with_the_packages(address):
    """No address of another machine stands where a browser would load from it."""
    text = ask(address, "/")[2]
    for found in re.findall(r"""(?:src|href|from|import|url\()\s*=?\s*["'](http[^"']*)""", text):
        assert "127.0.0.1" in found
