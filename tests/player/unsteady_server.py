"""A server on this machine that answers as told: well, with errors, never, or that is not there at all."""

from __future__ import annotations

import functools
import http.server
import threading
from pathlib import Path
from typing import Literal

Mood = Literal["well", "every third fails", "fails", "silent"]


class _Handler(http.server.SimpleHTTPRequestHandler):
    """Serves ranges of files as its server's mood allows."""

    server: _Server

    def do_GET(self) -> None:
        served = self.server.owner
        served.requests += 1
        mood = served.mood
        if mood == "silent":
            served.speaks.wait(60)
            self.close_connection = True
            return
        if mood == "fails" or (mood == "every third fails" and served.requests % 3 == 0):
            served.refused += 1
            self.send_error(503)
            return
        path = Path(self.translate_path(self.path))
        if not path.is_file():
            self.send_error(404)
            return
        content = path.read_bytes()
        wanted = self.headers.get("Range")
        first, last = wanted.removeprefix("bytes=").split("-") if wanted else ("0", str(len(content) - 1))
        part = content[int(first) : int(last) + 1]
        self.send_response(206 if wanted else 200)
        self.send_header("Content-Length", str(len(part)))
        self.end_headers()
        self.wfile.write(part)

    def log_message(self, *_: object) -> None:
        """Keeps quiet."""


class _Server(http.server.ThreadingHTTPServer):
    """Knows to whom it belongs."""

    owner: UnsteadyServer
    daemon_threads = True
    block_on_close = False

    def handle_error(self, *_: object) -> None:
        """Clients that have gone away are expected."""


class UnsteadyServer:
    """Serves a folder. Use it as a context manager."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._server: _Server | None = None
        self._port = 0
        self.speaks = threading.Event()
        self.mood: Mood = "well"
        self.requests = 0
        self.refused = 0

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self._port}"

    def become(self, mood: Mood) -> None:
        """Answers so from now on; requests that were met with silence end without an answer."""
        self.mood = mood
        self.speaks.set()
        self.speaks = threading.Event()

    def live(self) -> None:
        """Is there (again), at the same address."""
        self._server = _Server(("127.0.0.1", self._port), functools.partial(_Handler, directory=str(self._folder)))
        self._server.owner = self
        self._port = self._server.server_port
        threading.Thread(target=self._server.serve_forever, args=(0.01,), daemon=True).start()

    def die(self) -> None:
        """Is not there any more."""
        assert self._server is not None
        self._server.shutdown()
        self._server.server_close()
        self._server = None

    def __enter__(self) -> UnsteadyServer:
        self.live()
        return self

    def __exit__(self, *_: object) -> None:
        self.become("well")
        if self._server is not None:
            self.die()
