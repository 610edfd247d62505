"""What a page that was tampered with could try, and a server that counts what reaches it."""

import http.server
import threading
from contextlib import contextmanager

# what a page that was tampered with could try, and the rule of the policy that forbids it
ATTEMPTS = {
    "fetch": ("fetch(THERE).catch(() => 0)", "connect-src"),
    "post": (
        "fetch(THERE, {method: 'POST', body: 'x', mode: 'no-cors'}).catch(() => 0)",
        "connect",
    ),
    "XMLHttpRequest": ("const x = new XMLHttpRequest(); x.open('GET', THERE); x.send()", "connect"),
    "beacon": ("navigator.sendBeacon(THERE, 'x')", "connect-src"),
    "EventSource": ("new EventSource(THERE)", "connect-src"),
    "WebSocket": ("new WebSocket(THERE.replace('http', 'ws'))", "connect-src"),
    "image": ("new Image().src = THERE", "img-src"),
    "sound": ("new Audio(THERE).load()", "media-src"),
    "font": ("new FontFace('x', `url(${THERE})`).load().catch(() => 0)", "font-src"),
    "style sheet": ("add('link', {rel: 'stylesheet', href: THERE})", "style-src"),
    "picture of a style": ("document.body.style.background = `url(${THERE})`", "img-src"),
    "frame": ("add('iframe', {src: THERE})", "frame-src"),
    "object": ("add('object', {data: THERE})", "object-src"),
    "worker": ("new Worker(URL.createObjectURL(new Blob(['']))).onerror = () => 0", "worker-src"),
    "script from there": ("add('script', {src: THERE})", "script-src"),
    "script of another": ("add('script', {textContent: 'window.taken = true'})", "script-src"),
    # browsers judge it when it is set, or when it is first needed
    "handler": (
        "const button = add('button', {}); button.setAttribute('onclick', 'window.taken = true'); "
        "button.click()",
        "script-src",
    ),
    # later, since a debugger's own script may evaluate what it likes
    "eval": (
        "setTimeout(() => { try { eval('window.taken = true') } catch (refused) {} })",
        "script-src",
    ),
    "form": ("add('form', {action: THERE, method: 'POST'}).submit()", "form-action"),
    "base": ("add('base', {href: THERE})", "base-uri"),
}
# tries something, and waits until the policy says that it was broken
TRY = """
const done = arguments[arguments.length - 1], THERE = arguments[0], broken = [];
const add = (tag, given) => document.body.appendChild(
  Object.assign(document.createElement(tag), given));
window.taken = false;
document.addEventListener("securitypolicyviolation", (e) => {
  broken.push(e.effectiveDirective); setTimeout(() => done([broken, window.taken])); });
ATTEMPT;
"""


class _Counting(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        self.server.asked.append(f"{self.command} {self.path}")
        page = self.server.page.encode()
        self.send_response(200)
        self.send_header("Access-Control-Allow-Origin", "*")
        self.send_header("Content-Type", "text/html")
        self.send_header("Content-Length", str(len(page)))
        self.end_headers()
        self.wfile.write(page)

    do_POST = do_OPTIONS = do_GET  # noqa: N815 - names of the library

    def log_message(self, *words):
        pass


@contextmanager
def counting_server(page=""):
    """A server that answers everything with a page, and what it was asked."""
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), _Counting)
    server.asked, server.page = [], page
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_address[1]}/", server.asked
    server.shutdown()
    server.server_close()
