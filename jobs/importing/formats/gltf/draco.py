"""Primitives under KHR_draco_mesh_compression, decoded by Draco.

Draco's decoder is written for streams that Draco wrote: a damaged one may crash it, ask for any amount of memory, or
keep it busy for ever. So it runs in a process of its own, with as much memory and time as the sizes in the file's
header allow; whatever happens there becomes a ModelError here.
"""

from __future__ import annotations

import importlib.util
import json
import math
import os
import select
import subprocess
import sys
import time
import weakref
from pathlib import Path
from typing import IO

import numpy as np

from jobs.importing.formats.gltf.header import DRACO
from storage.base.errors import ModelError

#: Bytes of memory that the decoder may take: for each byte of a stream, each vertex and triangle, and anyhow.
_FOR_BYTE, _FOR_ITEM, _ANYHOW = 64, 500, 64 << 20

#: Seconds that it may take: for each vertex and triangle, and anyhow.
_SECONDS_FOR_ITEM, _SECONDS_ANYHOW = 1e-4, 30.0


def decoder_memory(vertices: int, triangles: int, stream: int) -> int:
    """Bytes that decoding a stream of that many bytes takes, an upper estimate."""
    return _ANYHOW + _FOR_ITEM * (vertices + triangles) + _FOR_BYTE * stream


class DracoDecoder:
    """Decodes the streams of one file, in a process that is started with the first of them."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._process: subprocess.Popen[bytes] | None = None

    def decode(
        self, stream: bytes, ids: list[int], vertices: int, triangles: int
    ) -> tuple[np.ndarray, list[np.ndarray]]:
        """Triangles (m, 3) int64 and the attributes (n, width) with some ids; as many as the accessors say there are.

        Raises ModelError for a damaged stream, or if the decoder is not installed.
        """
        request = {"stream": len(stream), "ids": ids, "memory": decoder_memory(vertices, triangles, len(stream))}
        seconds = _SECONDS_ANYHOW + _SECONDS_FOR_ITEM * (vertices + triangles)
        process = self._started()
        try:
            answer, arrays = _answer(process, json.dumps(request).encode() + b"\n" + stream, seconds)
        except (OSError, ValueError, EOFError):
            self._stop()
            raise self._damaged("the decoder gave up") from None
        if "error" in answer:
            raise self._damaged(str(answer["error"]))
        if any(len(array) != vertices for array in arrays[1:]):
            raise self._damaged(f"{len(arrays[1])} vertices instead of {vertices}")
        return arrays[0], arrays[1:]

    def _damaged(self, reason: str) -> ModelError:
        return ModelError(
            f"{self._file}: a mesh compressed with {DRACO} cannot be decoded ({reason[:160]}); the file is damaged, "
            "export it again"
        )

    def _started(self) -> subprocess.Popen[bytes]:
        if self._process is None:
            if importlib.util.find_spec("DracoPy") is None:
                raise ModelError(
                    f"{self._file}: compressed with {DRACO}, and the package DracoPy that reads it is not installed; "
                    "install vlod[jobs], or export the model without compression"
                )
            self._process = subprocess.Popen(
                [sys.executable, "-P", str(Path(__file__).with_name("draco_process.py"))],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            )
            weakref.finalize(self, _ended, self._process)
        return self._process

    def _stop(self) -> None:
        if self._process is not None:
            _ended(self._process)
            self._process = None


def _ended(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.wait()
    for stream in (process.stdin, process.stdout):
        if stream is not None and not stream.closed:
            try:
                stream.close()
            except OSError:  # what was not written yet is of no use any more
                continue


def _answer(
    process: subprocess.Popen[bytes], request: bytes, seconds: float
) -> tuple[dict[str, object], list[np.ndarray]]:
    """What the process answers. Raises OSError, ValueError or EOFError if it does not."""
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(request)
    process.stdin.flush()
    deadline = time.monotonic() + seconds
    line = bytearray()
    while not line.endswith(b"\n"):
        line += _read(process.stdout, 1, deadline)
    answer = json.loads(line)
    arrays = []
    for name, shape in answer.get("arrays", ()):
        dtype = np.dtype(name)
        data = _read(process.stdout, dtype.itemsize * math.prod(shape), deadline)
        arrays.append(np.frombuffer(data, dtype).reshape(shape))
    return answer, arrays


def _read(stream: IO[bytes], size: int, deadline: float) -> bytearray:
    """So many bytes of a pipe."""
    data = bytearray()
    while len(data) < size:
        ready, _, _ = select.select([stream], [], [], max(deadline - time.monotonic(), 0.0))
        if not ready:
            raise TimeoutError
        part = os.read(stream.fileno(), min(size - len(data), 1 << 20))
        if not part:
            raise EOFError
        data += part
    return data
