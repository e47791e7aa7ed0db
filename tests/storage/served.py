"""A folder served over HTTP, on a thread."""

from __future__ import annotations

import functools
import http.server
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class Plain(http.server.SimpleHTTPRequestHandler):
    """Serves a folder and knows nothing of ranges."""

    def log_message(self, *_: object) -> None:
        """Keeps quiet."""


@contextmanager
def served(folder: Path, handler: type = Plain) -> Iterator[str]:
    """The address of a folder, for as long as the context lasts."""
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(handler, directory=str(folder)))
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
