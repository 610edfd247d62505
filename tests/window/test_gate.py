"""The window answers its own user alone, and with nothing from outside its folder.

A window runs as a process of its own and is asked by plain HTTP, as a stranger would.
"""

import http.client
import os
import re
import subprocess
import sys
from contextlib import closing

import pytest

pytest.importorskip("nicegui")

from stepblocks.cli import main

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
    if own:
        headers.setdefault("Cookie", f"stepblocks-{port}={token}")
    with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=60)) as line:
        line.request(method, path, body=body, headers=headers)
        with line.getresponse() as answer:
            return answer.status, answer.headers, answer.read().decode(errors="replace")


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


def ask_for_upload(address, path, header):
    """Status of what a window answers to the headers of an upload, before anything is sent."""
    port, token = address
    with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=60)) as line:
        line.putrequest("POST", path)
        line.putheader("Cookie", f"stepblocks-{port}={token}")
        line.putheader(*header)
        line.endheaders()
        with line.getresponse() as answer:
            return answer.status


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
    # the server may refuse a length that is none before the gate
    assert ask_for_upload(address, path, ("Content-Length", length)) in (status, 400)


def test_a_request_that_does_not_say_its_length_is_refused(address):
    assert ask_for_upload(address, "/", ("Transfer-Encoding", "chunked")) == 411


def test_a_port_that_is_taken_and_a_folder_that_is_none_are_one_line(address, tmp_path, capsys):
    port, _ = address
    for words, message in (
        ([str(tmp_path), "--port", str(port)], f"error: port must be free, got {port}"),
        ([str(tmp_path / "none")], "error: folder must be there, got none"),
    ):
        assert main(["app", *words, "--no-open"]) == 2
        printed = capsys.readouterr().err
        assert printed.startswith(f"stepblocks: {message}")
        assert printed.count("\n") == 1


def test_without_the_extra_the_command_names_it(tmp_path, monkeypatch, capsys):
    monkeypatch.delitem(sys.modules, "stepblocks.window.window", raising=False)
    monkeypatch.setitem(sys.modules, "nicegui", None)  # as where it is not installed
    assert main(["app", str(tmp_path), "--no-open"]) == 2
    assert capsys.readouterr().err == (
        "stepblocks: error: the window needs nicegui: install the extra with pip install "
        "'stepblocks[app]'\n"
    )


def test_without_the_window_the_command_line_does_not_load_the_framework():
    """The program starts as fast, and runs as it is, where the extra is not installed."""
    code = (
        "import sys; sys.modules['nicegui'] = sys.modules['tomlkit'] = None\n"
        "import stepblocks; from stepblocks.cli import main; sys.exit(main(['--help']))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    assert b"app" in done.stdout


def test_every_script_and_font_comes_with_the_packages(address):
    """No address of another machine stands where a browser would load from it."""
    text = ask(address, "/")[2]
    for found in re.findall(r"""(?:src|href|from|import|url\()\s*=?\s*["'](http[^"']*)""", text):
        assert "127.0.0.1" in found
