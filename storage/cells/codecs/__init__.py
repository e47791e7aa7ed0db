"""Codecs for lists of drawable ids: one file a code, all behind `Codec`.

Read in this order:
    gap_varint   gaps between ids, as
    varint       numbers of one to five bytes

A new code is a module with its `CODEC`, and a line in MODULES.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Protocol

from storage.base.errors import StoreFormatError
from storage.cells.deltas import Ids


class Codec(Protocol):
    """Turns lists of ids into bytes and back."""

    @property
    def name(self) -> str:
        """What stores call this code."""
        ...

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


#: Where the codes are: each module has its `CODEC`.
MODULES = ("storage.cells.codecs.gap_varint",)

#: The code that new stores are written with.
DEFAULT = "gap-varint-zstd"


def codecs() -> dict[str, Codec]:
    """All codes by their names."""
    found: list[Codec] = [importlib.import_module(module).CODEC for module in MODULES]
    return {codec.name: codec for codec in found}


def codec_named(name: str) -> Codec:
    """The codec of that name. Raises StoreFormatError for an unknown one."""
    known = codecs()
    if name not in known:
        raise StoreFormatError(f"the store uses the code {name!r}; this vLOD knows {', '.join(sorted(known))}")
    return known[name]
