"""Live pages: a read-only server for this machine alone, with pages that reload when a file changes.

The standard library's server suffices for one reader and a few pages in memory. Requests never name files in
a folder, so path traversal is impossible.
"""

from __future__ import annotations

import errno
import socket
import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import BoundedSemaphore, Lock, Timer
from time import sleep
from typing import Any
from urllib.parse import urlsplit

from etude.errors import EtudeError, UsageError
from etude.report.markup import text

LONGEST_S, SILENT_S, MOST = 60.0, 10.0, 16
"""Longest duration of a request, s; timeout for its next byte, s; and number of simultaneous requests: a
browser opens six."""
HOST, PORT, PORTS = "127.0.0.1", 8716, 20
"""Default port of the pages, and number of ports that are tried from there."""
FULL = b"HTTP/1.0 503 Service Unavailable\r\nRetry-After: 1\r\nContent-Length: 0\r\n\r\n"
DIGEST = "/digest"
INDEX = "index.html"
POSES, POSES_HZ = "/poses", 25.0
"""Address of the stream of poses, and its rate, which suffices for the eye."""
TYPES = {
    "html": "text/html",
    "css": "text/css",
    "js": "text/javascript",
    "json": "application/json",
    "sse": "text/event-stream",
}
POLICY = "default-src 'self' 'unsafe-inline' data:; form-action 'none'; frame-ancestors 'none'"
"""Content security policy: a page must not load anything from other hosts."""
SCRIPT = """<script>
(() => {
  const shown = "DIGEST";
  const look = async () => {
    try {
      const now = await (await fetch("/digest", { cache: "no-store" })).text();
      if (now !== shown) { await fetch(location.href, { cache: "no-store" }); location.reload(); }
    } catch (away) { return; }
  };
  setInterval(look, 1000);
})();
</script>
"""
"""Asks every second whether something happened; a server that went away is asked again. The new page is
waited for, since its making takes time: if the server ends meanwhile, the old one stays.
"""


@dataclass
class Pages:
    """Pages of a server, made on request from what was read at the last change of `digest`.

    Attributes:
        made: functions that make the pages, by name, "index.html" among them.
        digest: a word that changes with the sources of the pages; cheap.
        pose: the newest message for `POSES`; None for pages without poses.
    """

    made: Callable[[], Mapping[str, Callable[[], str]]]
    digest: Callable[[], str]
    pose: Callable[[], str] | None = None
    _cache: tuple[str, Mapping[str, Callable[[], str]]] | None = None
    _lock: Lock = field(default_factory=Lock)

    def page(self, path: str) -> bytes | None:
        """The page of a request's path, or None. EtudeError: it cannot be made now."""
        with self._lock:
            now = self.digest()
            if self._cache is None or self._cache[0] != now:
                self._cache = now, self.made()
            render = self._cache[1].get(path.removeprefix("/") or INDEX)
            if render is None:
                return None
            return render().replace("</body>", f"{_script(now)}</body>").encode()


def _script(digest: str) -> str:
    """Script that reloads a page made from the sources of `digest`."""
    return SCRIPT.replace("DIGEST", digest)


def digest_of(paths: Iterable[Path]) -> str:
    """Digest of the sizes and times of files, including those in folders; missing files are no error."""
    stats = []
    for path in paths:
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            with suppress(OSError):
                stat = file.stat()
                stats.append(f"{stat.st_size}.{stat.st_mtime_ns}")
    return f"{len(stats)}-{hash(tuple(stats)) & 0xFFFFFFFFFFFFFFFF:x}"


def server(pages: Pages, port: int | None) -> ThreadingHTTPServer:
    """A server of these pages on a port of this machine, not started.

    Args:
        pages: to be served.
        port: None: the first free port from `PORT` on; 0: any free port.

    Raises:
        UsageError: the port is in use, not allowed, or invalid.
    """

    class Handler(_Handler):
        served = pages

    ports = range(PORT, PORT + PORTS) if port is None else [port]
    problem: Exception | None = None
    for candidate in ports:
        try:
            return _Server((HOST, candidate), Handler)
        except (OSError, OverflowError) as error:
            problem = error
    raise _refused(ports[0], problem)


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    allow_reuse_address = False

    def __init__(self, address: tuple[str, int], handler: type[BaseHTTPRequestHandler]) -> None:
        self.places = BoundedSemaphore(MOST)
        super().__init__(address, handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Handles a request in its own thread while a place is free; otherwise asks the client to retry."""
        if self.places.acquire(blocking=False):
            super().process_request(request, client_address)
            return
        with suppress(OSError):
            request.settimeout(1.0)
            request.sendall(FULL)
        self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Handles the request and ends with it, even for a slow client."""
        ended = Timer(LONGEST_S, _shut_down, (request,))
        ended.daemon = True
        ended.start()
        try:
            super().process_request_thread(request, client_address)
        finally:
            ended.cancel()
            self.places.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore disconnected clients; handle other errors like the library."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


def _shut_down(request: socket.socket) -> None:
    with suppress(OSError):
        request.shutdown(socket.SHUT_RDWR)


def _refused(port: int, problem: Exception | None) -> UsageError:
    used = isinstance(problem, OSError) and problem.errno == errno.EADDRINUSE
    fact = f"port {port} is in use" if used else f"port {port} cannot be opened: {problem}"
    with socket.create_server((HOST, 0)) as free:
        offered = free.getsockname()[1]
    return UsageError(fact, where="--port", next_step=f"Free now: --port {offered}; or leave out --port.")


class _Handler(BaseHTTPRequestHandler):
    """Answers GET and HEAD; the library refuses other methods."""

    served: Pages
    timeout = SILENT_S
    server_version, sys_version = "etude", ""

    def do_GET(self) -> None:
        """Sends a page, the digest, or messages until the time limit of a request."""
        if self.path == POSES and self.served.pose is not None and self._is_own():
            self._stream(self.served.pose)
        else:
            self._answer(body=True)

    def do_HEAD(self) -> None:
        """As GET, without the content."""
        self._answer(body=False)

    def log_message(self, format: str, *args: object) -> None:
        """Logs nothing, because a page asks every second."""

    def _answer(self, body: bool) -> None:
        status, kind, content = self._response()
        with suppress(ConnectionError):  # the client disconnected
            self.send_response(status)
            for name, value in _headers(kind, len(content)).items():
                self.send_header(name, value)
            self.end_headers()
            if body:
                self.wfile.write(content)

    def _stream(self, pose: Callable[[], str]) -> None:
        """Server-sent events: each new message, or an empty line without one."""
        with suppress(OSError):  # the client disconnected, or the request timed out
            self.send_response(HTTPStatus.OK)
            for name, value in _headers("sse", None).items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(b"retry: 300\n\n")
            sent = ""
            while True:
                now = pose()
                self.wfile.write(f"data: {now}\n\n".encode() if now != sent else b":\n\n")
                sent = now
                sleep(1.0 / POSES_HZ)

    def _is_own(self) -> bool:
        """Whether the request names this machine, as a protection against DNS rebinding."""
        port = self.connection.getsockname()[1]
        return self.headers.get_all("Host", []) in ([f"{HOST}:{port}"], [f"localhost:{port}"])

    def _response(self) -> tuple[HTTPStatus, str, bytes]:
        host = self.headers.get_all("Host", [])
        try:
            path = urlsplit(self.path).path
        except ValueError:  # brackets that are no address
            path = ""
        if len(host) != 1 or not path.startswith("/") or not path.isprintable():
            return HTTPStatus.BAD_REQUEST, "html", b"<title>Bad request</title>This is no request for a page."
        if not self._is_own():
            return HTTPStatus.FORBIDDEN, "html", b"This is served to its own machine only."
        if path == DIGEST:
            return HTTPStatus.OK, "txt", self.served.digest().encode()
        try:
            page = self.served.page(path)
        except EtudeError as error:
            body = f"<title>Étude</title><p>{text(error)}</p>{_script(self.served.digest())}"
            return HTTPStatus.SERVICE_UNAVAILABLE, "html", body.encode()
        if page is None:
            return HTTPStatus.NOT_FOUND, "html", "<title>Étude</title>There is no such page.".encode()
        return HTTPStatus.OK, (path.rpartition(".")[2] if "." in path else "html"), page


def _headers(kind: str, length: int | None) -> dict[str, str]:
    """Headers of an answer.

    Args:
        kind: media type.
        length: of the content, bytes; None for a stream.
    """
    return {
        "Content-Type": f"{TYPES.get(kind, 'text/plain')}; charset=utf-8",
        **({} if length is None else {"Content-Length": str(length)}),
        "Content-Security-Policy": POLICY,
        "Cache-Control": "no-store",
        "X-Content-Type-Options": "nosniff",
    }
