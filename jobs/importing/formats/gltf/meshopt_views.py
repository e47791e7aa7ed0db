"""Buffer views under EXT_meshopt_compression and KHR_meshopt_compression, decoded by meshoptimizer.

Both extensions' section "Specifying compressed views": a view is decoded as a whole, by one of three modes (ATTRIBUTES,
TRIANGLES, INDICES), and what comes out is passed through a filter (OCTAHEDRAL, QUATERNION, EXPONENTIAL; COLOR). Where
the view's own buffer holds the data uncompressed, `jobs.importing.formats.gltf.accessors` reads that instead.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from jobs.importing.formats.gltf.header import MESHOPT, Json
from storage.base.errors import ModelError

_MODES = ("ATTRIBUTES", "TRIANGLES", "INDICES")
_FILTERS = ("NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "COLOR")

#: The most bytes that a byte of a vertex stream stands for: four bits of control for four bytes of each of 256 rows.
_DENSEST = 2048


def compression_of(view: Json) -> tuple[str, Json] | None:
    """The extension that compresses a view and what it says, None if it is plain."""
    for name in MESHOPT:
        if name in view.get("extensions", {}):
            return name, view["extensions"][name]
    return None


def check_compression(file: Path, number: int, name: str, entry: Json) -> None:
    """Raise ModelError unless a compressed view makes sense, and claims no more than its bytes can hold."""
    sizes = [entry[key] for key in ("count", "byteStride", "byteLength")] + [entry.get("byteOffset", 0)]
    mode, chosen = entry.get("mode"), entry.get("filter", "NONE")
    if mode not in _MODES or chosen not in _FILTERS:
        raise ModelError(
            f"{file}: buffer view {number} is compressed by {name} with mode {str(mode)[:20]} and filter "
            f"{str(chosen)[:20]}, which is not read; export it without compression"
        )
    sane = all(isinstance(size, int) and size >= 0 for size in sizes)
    if sane:
        count, stride, length, _ = sizes
        if mode == "ATTRIBUTES":
            sane = 0 < stride <= 256 and stride % 4 == 0 and count * stride <= _DENSEST * length
        else:
            sane = stride in (2, 4) and count <= (3 if mode == "TRIANGLES" else 1) * length
            sane = sane and (mode == "INDICES" or count % 3 == 0)
        if chosen in ("OCTAHEDRAL", "COLOR"):
            sane = sane and stride in (4, 8)
        if chosen == "QUATERNION":
            sane = sane and stride == 8
    if not sane:
        raise ModelError(
            f"{file}: buffer view {number} claims more than its compressed bytes can hold, or rows that {name} does "
            "not know; the file is damaged, export it again"
        )


def decoded(file: Path, number: int, name: str, entry: Json, data: bytes) -> np.ndarray:
    """The bytes (count * stride,) uint8 of a view that `check_compression` found sane. Raises ModelError."""
    try:
        import meshopt
    except ImportError:
        raise ModelError(
            f"{file}: compressed with {name}, and the package meshopt that reads it is not installed; "
            "install vlod[jobs], or export the model without compression"
        ) from None
    count, stride, chosen = entry["count"], entry["byteStride"], entry.get("filter", "NONE")
    if not count:
        return np.empty(0, np.uint8)
    try:
        rows = meshopt.decode_gltf_buffer(
            data, count, stride, entry["mode"], chosen if entry["mode"] == "ATTRIBUTES" else None
        )
    except (ValueError, RuntimeError) as error:
        raise ModelError(
            f"{file}: buffer view {number} cannot be decoded by {name} ({error}); the file is damaged, export it again"
        ) from None
    return np.ascontiguousarray(rows).reshape(-1).view(np.uint8)
