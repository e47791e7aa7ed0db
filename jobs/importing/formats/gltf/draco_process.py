"""The process that decodes Draco streams for `jobs.importing.formats.gltf.draco`; it runs as a program of its own.

It reads requests from its input and writes answers to its output, each a line of JSON and bytes whose number the line
says. A request: {"stream": bytes, "ids": [attribute id, ...], "memory": bytes that it may take beside what it has}. An
answer: {"arrays": [[dtype, shape], ...]} and the arrays' bytes, the triangles first; or {"error": what is wrong}.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import sys
from collections.abc import Iterator
from pathlib import Path

import DracoPy
import numpy as np


def main() -> None:
    """Answer requests until there are no more."""
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what the decoder prints is no answer
    for line in requests:
        request = json.loads(line)
        arrays: list[np.ndarray] = []
        try:
            with _memory_limit(int(request["memory"])):
                arrays = _decoded(requests.read(request["stream"]), request["ids"])
            answer: dict[str, object] = {"arrays": [[array.dtype.str, array.shape] for array in arrays]}
        except Exception as error:  # it raises almost anything on damaged streams
            answer = {"error": " ".join(str(error).split())[:160] or type(error).__name__}
        answers.write(json.dumps(answer).encode() + b"\n")
        for array in arrays:
            answers.write(array.tobytes())
        answers.flush()


def _decoded(stream: bytes, ids: list[int]) -> list[np.ndarray]:
    """Triangles (m, 3) and the attributes with some ids, (n, width) each."""
    mesh = DracoPy.decode(stream)
    found = {entry["unique_id"]: entry["data"] for entry in mesh.attributes}
    triangles = np.ascontiguousarray(mesh.faces).astype("<i8").reshape(-1, 3)
    return [triangles, *(np.ascontiguousarray(found[number]) for number in ids)]


@contextlib.contextmanager
def _memory_limit(more: int) -> Iterator[None]:
    """For a while the process may take no more memory than it has, and so many bytes."""
    pages = Path("/proc/self/statm")
    if not pages.exists():
        yield
        return
    now = int(pages.read_text().split()[0]) * resource.getpagesize()
    _, most = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (now + more, most))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (most, most))


if __name__ == "__main__":
    main()
