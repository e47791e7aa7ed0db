"""Arrays of numbers out of a file's buffers: strided, normalised, sparse, compressed.

glTF 2.0, sections 3.6.1 and 3.6.2. The file is never held: what one accessor needs is read when it is asked for. Every
declared size is checked against the bytes that are there before anything is read.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from jobs.importing.formats.gltf.header import DRACO, Json
from jobs.importing.formats.gltf.meshopt_views import check_compression, compression_of, decoded
from jobs.importing.reading.content import Content
from jobs.importing.reading.resources import Resources
from storage.base.errors import ModelError

_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}

#: The most zeros that an accessor without data may stand for.
_ZEROS = 1 << 24

#: Views that were decompressed are kept for the next accessor up to this many bytes.
VIEWS_KEPT = 1 << 26


def at(index: Any) -> int:
    """An index into one of the header's lists; negative ones must not count from the end. Raises IndexError."""
    if not isinstance(index, int) or index < 0:
        raise IndexError(f"index {index!r} is out of range")
    return index


def open_buffers(file: Path, header: Json, chunk: Content | None, resources: Resources) -> list[Content | None]:
    """The buffers' bytes; None for one that is not there and that only compressed views lie in. Raises ModelError."""
    needed = {at(view["buffer"]) for view in header.get("bufferViews", ()) if compression_of(view) is None}
    buffers: list[Content | None] = []
    for number, buffer in enumerate(header.get("buffers", ())):
        uri, wanted = buffer.get("uri"), int(buffer["byteLength"])
        data = chunk if uri is None and number == 0 else None if uri is None else resources.open(str(uri))
        if (data is None or data.size < wanted) and (number in needed or not _placeholder(header, number)):
            name = "the binary chunk" if uri is None else f"the buffer {str(uri)[:80]!r}"
            if data is not None:
                raise ModelError(f"{file}: {name} is cut short, {data.size} of {wanted} bytes; copy or export it again")
            raise ModelError(f"{file}: {name} is missing; put it into the model's folder, or export the model again")
        buffers.append(data if data is not None and data.size >= wanted else None)
    return buffers


def _placeholder(header: Json, number: int) -> bool:
    """Whether compressed views, and nothing else, lie in a buffer."""
    return any(view["buffer"] == number for view in header.get("bufferViews", ()))


@dataclass(eq=False)
class Accessors:
    """A file's arrays, decoded as they are asked for."""

    file: Path
    header: Json
    buffers: list[Content | None]
    _decoded: dict[int, np.ndarray] = field(default_factory=dict)  # compressed views; the one used last comes last

    def check(self) -> None:
        """Raise ModelError unless all the bytes of every accessor are there."""
        elsewhere = _in_draco_streams(self.header)
        for number, accessor in enumerate(self.header.get("accessors", ())):
            self._check(number, accessor, number in elsewhere)
            for extra in _patches(accessor) if "sparse" in accessor else ():
                self._check(number, extra, False)

    def _check(self, number: int, accessor: Json, elsewhere: bool) -> None:
        """Raise ModelError unless all the bytes of an accessor are there."""
        count = accessor["count"]
        item = np.dtype(_COMPONENTS[accessor["componentType"]]).itemsize * _WIDTHS[accessor["type"]]
        if not isinstance(count, int) or count < 0:
            raise ModelError(f"{self.file}: accessor {number} has the count {count!r}; export the model again")
        if "bufferView" not in accessor:
            if count > _ZEROS and not elsewhere:
                raise ModelError(
                    f"{self.file}: accessor {number} claims {count} items but has no data; export the model again"
                )
            return
        view = self.header["bufferViews"][at(accessor["bufferView"])]
        start, length = view.get("byteOffset", 0), view["byteLength"]
        offset, stride = accessor.get("byteOffset", 0), view.get("byteStride", item)
        needed = offset + (count - 1) * stride + item if count else 0
        sane = (
            all(isinstance(n, int) and n >= 0 for n in (start, length, offset))
            and isinstance(stride, int)
            and stride > 0
        )
        if not sane or needed > length or length > self._available(accessor["bufferView"]):
            raise ModelError(
                f"{self.file}: accessor {number} ({count} items) reaches beyond the file's data; "
                "the file is damaged or cut short, export it again"
            )

    def _available(self, number: int) -> int:
        """Bytes that there are of a view. Raises ModelError for a compressed one that makes no sense."""
        view = self.header["bufferViews"][number]
        compression = self._compression(view)
        if compression is None:
            buffer = self.buffers[at(view["buffer"])]
            return 0 if buffer is None else buffer.size - view.get("byteOffset", 0)
        name, entry = compression
        check_compression(self.file, number, name, entry)
        buffer = self.buffers[at(entry["buffer"])]
        if buffer is None or entry.get("byteOffset", 0) + entry["byteLength"] > buffer.size:
            return 0
        return entry["count"] * entry["byteStride"]

    def _compression(self, view: Json) -> tuple[str, Json] | None:
        """How a view is compressed; None where its data is there as it is."""
        compression = compression_of(view)
        return compression if compression is not None and self.buffers[at(view["buffer"])] is None else None

    def view(self, number: int, start: int, end: int) -> bytes | np.ndarray:
        """Bytes start ... end - 1 of a view."""
        view = self.header["bufferViews"][at(number)]
        compression = self._compression(view)
        if compression is None:
            buffer, first = self.buffers[at(view["buffer"])], view.get("byteOffset", 0)
            return b"" if buffer is None else buffer.part(first + start, first + end)
        if number in self._decoded:
            self._decoded[number] = self._decoded.pop(number)
        else:
            name, entry = compression
            buffer, first = self.buffers[at(entry["buffer"])], entry.get("byteOffset", 0)
            data = b"" if buffer is None else buffer.part(first, first + entry["byteLength"])
            self._decoded[number] = decoded(self.file, number, name, entry, data)
            while len(self._decoded) > 1 and sum(kept.nbytes for kept in self._decoded.values()) > VIEWS_KEPT:
                del self._decoded[next(iter(self._decoded))]
        return self._decoded[number][start:end]

    def whole_view(self, number: int) -> bytes:
        """All bytes of a view that no accessor describes."""
        return bytes(self.view(number, 0, int(self.header["bufferViews"][at(number)]["byteLength"])))

    def has_data(self, number: int) -> bool:
        """Whether an accessor has data of its own, and does not stand for zeros."""
        accessor = self.header["accessors"][at(number)]
        return "bufferView" in accessor or "sparse" in accessor

    def count(self, number: int) -> int:
        """How many items an accessor has."""
        return int(self.header["accessors"][at(number)]["count"])

    def integers(self, number: int) -> np.ndarray:
        """An accessor's values as int64, in one row."""
        return self._values(number).reshape(-1).astype(np.int64)

    def floats(self, number: int) -> np.ndarray:
        """An accessor's values (count, width) as float64; normalised integers become -1 to 1 or 0 to 1."""
        return self.as_floats(number, self._values(number))

    def as_floats(self, number: int, values: np.ndarray) -> np.ndarray:
        """Values that were stored elsewhere, as an accessor would give them."""
        accessor = self.header["accessors"][at(number)]
        dtype = np.dtype(_COMPONENTS[accessor["componentType"]])
        if values.dtype != dtype and values.dtype.kind in "iu" and dtype.kind in "iu":
            values = values.astype(dtype)
        if accessor.get("normalized") and values.dtype.kind in "iu":
            return np.maximum(values / np.iinfo(values.dtype).max, -1.0)
        return values.astype(np.float64)

    def _values(self, number: int) -> np.ndarray:
        """An accessor's values (count, width) as they are stored."""
        accessor = self.header["accessors"][at(number)]
        values = self._stored(accessor)
        if "sparse" in accessor:
            values = values.copy()
            places, changed = (self._stored(extra) for extra in _patches(accessor))
            values[places[:, 0]] = changed
        return values

    def _stored(self, accessor: Json) -> np.ndarray:
        """The same without what a sparse accessor changes; read from the file now."""
        shape = (accessor["count"], _WIDTHS[accessor["type"]])
        dtype = np.dtype(_COMPONENTS[accessor["componentType"]])
        if "bufferView" not in accessor or not shape[0]:
            return np.zeros(shape, dtype)
        view = self.header["bufferViews"][at(accessor["bufferView"])]
        item = dtype.itemsize * shape[1]
        stride = view.get("byteStride", item)
        start = accessor.get("byteOffset", 0)
        data = self.view(accessor["bufferView"], start, start + (shape[0] - 1) * stride + item)
        return np.ndarray(shape, dtype, data, strides=(stride, dtype.itemsize))


def _patches(accessor: Json) -> list[Json]:
    """A sparse accessor's places and values, as accessors of their own."""
    sparse = accessor["sparse"]
    common = {"count": sparse["count"], "componentType": accessor["componentType"]}
    return [{**common, "type": "SCALAR", **sparse["indices"]}, {**common, "type": accessor["type"], **sparse["values"]}]


def _in_draco_streams(header: Json) -> set[int]:
    """The accessors of compressed primitives."""
    found: set[int] = set()
    for mesh in header.get("meshes", ()):
        for primitive in mesh["primitives"]:
            if DRACO in primitive.get("extensions", {}):
                found.update(primitive.get("attributes", {}).values())
                found.update([primitive["indices"]] if "indices" in primitive else [])
    return found


def decompressed_bytes(header: Json) -> int:
    """Bytes that decompressed views may take, an upper estimate."""
    sizes = [
        int(entry["count"]) * int(entry["byteStride"])
        for view in header.get("bufferViews", ())
        if (found := compression_of(view)) is not None
        for entry in [found[1]]
    ]
    return min(sum(sizes), VIEWS_KEPT + max(sizes, default=0))
