"""Structured arrays and lists of strings as frames.

A table's bytes are transposed (first bytes of all rows, then second bytes, and so on) before they are compressed: equal
bytes of a field then lie side by side.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np
import zstandard

from storage.base.errors import CorruptStoreError, StoreFormatError

#: zstd level of tables: they are written once and read at every start.
LEVEL = 9


def pack_table(table: np.ndarray) -> bytes:
    """A structured array (n,) as bytes: length of a JSON head (u4), the head (rows, fields), the compressed columns."""
    rows = np.ascontiguousarray(table)
    head = json.dumps({"rows": len(rows), "fields": _fields(rows.dtype)}, separators=(",", ":")).encode()
    columns = np.ascontiguousarray(rows.view(np.uint8).reshape(len(rows), rows.dtype.itemsize).T)
    return len(head).to_bytes(4, "little") + head + zstandard.ZstdCompressor(LEVEL).compress(columns.tobytes())


def unpack_table(data: bytes, dtype: np.dtype) -> np.ndarray:
    """The structured array (n,) that `pack_table` packed; read-only.

    Raises StoreFormatError if its fields are not those of `dtype`, CorruptStoreError if the bytes make no sense.
    """
    try:
        start = 4 + int.from_bytes(data[:4], "little")
        head = json.loads(data[4:start])
        rows, fields = int(head["rows"]), head["fields"]
        content = zstandard.ZstdDecompressor().decompress(data[start:])
    except (ValueError, KeyError, TypeError, zstandard.ZstdError) as error:
        raise CorruptStoreError(f"a table cannot be decoded: {error}") from error
    if fields != _fields(dtype):
        raise StoreFormatError(f"a table has the fields {fields}, not {_fields(dtype)}; rebuild the store")
    if len(content) != rows * dtype.itemsize:
        raise CorruptStoreError(f"a table has {len(content)} bytes, not {rows} rows of {dtype.itemsize}")
    columns = np.frombuffer(content, np.uint8).reshape(dtype.itemsize, rows)
    table = np.ascontiguousarray(columns.T).reshape(-1).view(dtype)
    table.flags.writeable = False
    return table


def pack_names(names: Sequence[str]) -> bytes:
    """A list of strings as bytes."""
    return zstandard.ZstdCompressor(LEVEL).compress(json.dumps(list(names), ensure_ascii=False).encode())


def unpack_names(data: bytes) -> tuple[str, ...]:
    """The strings that `pack_names` packed. Raises CorruptStoreError if the bytes make no sense."""
    try:
        return tuple(str(name) for name in json.loads(zstandard.ZstdDecompressor().decompress(data)))
    except (ValueError, TypeError, zstandard.ZstdError) as error:
        raise CorruptStoreError(f"a list of names cannot be decoded: {error}") from error


def _fields(dtype: np.dtype) -> list[list[object]]:
    """Names, types and shapes of a structured dtype's fields, as JSON holds them."""
    fields: list[list[object]] = []
    for name in dtype.names or ():
        inner, shape = dtype[name].base, dtype[name].shape
        fields.append([name, inner.str, list(shape)])
    return fields
