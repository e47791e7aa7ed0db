"""Codecs for lists of drawable ids: one file each, all behind `Codec`.

Read in this order:
    gap_varint       gaps between ids, as
    varint           numbers of one to five bytes
    delimiter        the vLOD paper's own code of offsets and runs
    group            cells that are coded together, and what is known of them before
    contexts         each cell once, given its cut: codes groups; no store is written with it yet
    context_mixing   its inner loop

A new codec is a module with its `CODEC`, and a line in CODECS. Importing this package imports none of them.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

from storage.base.errors import StoreFormatError

if TYPE_CHECKING:
    from storage.cells.deltas import Ids


class Codec(Protocol):
    """Turns lists of ids into bytes and back."""

    @property
    def block_ids(self) -> int:
        """A block of changes is closed when it holds this many ids: larger ones compress better and read slower."""
        ...

    def encode(self, lists: Sequence[Ids]) -> bytes:
        """Bytes of lists of strictly increasing ids, uint32 (n,) each; lists may be empty."""
        ...

    def decode(self, data: bytes) -> list[Ids]:
        """The lists again. Raises CorruptStoreError if the bytes make no sense."""
        ...


#: What stores call each codec, and the module that has its `CODEC`.
CODECS = {
    "gap-varint-zstd": "storage.cells.codecs.gap_varint",
    "delimiter": "storage.cells.codecs.delimiter",
}

#: The codec that new stores are written with.
DEFAULT = "gap-varint-zstd"


def codec_named(name: str) -> Codec:
    """The codec of that name. Raises StoreFormatError for an unknown one."""
    if name not in CODECS:
        raise StoreFormatError(f"the store uses the codec {name!r}; this vLOD knows {', '.join(CODECS)}")
    codec: Codec = importlib.import_module(CODECS[name]).CODEC
    return codec
