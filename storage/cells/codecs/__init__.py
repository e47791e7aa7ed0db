"""Codecs for what can be seen from the cells of a group: one file each, all behind `Codec`.

Read in this order:
    contexts           the default: each cell once, given its cut and the cells before
    context_mixing     its inner loop
    changes            a codec of lists as one of groups: a whole set, then changes
    gap_varint         lists as gaps between ids, as
    varint             numbers of one to five bytes
    delimiter          lists in the vLOD paper's own code, of
    offsets_and_runs   numbers with two bits between them

A new codec is a module with its `CODEC`, and a line in CODECS. Importing this package imports none of them.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

from storage.base.errors import StoreFormatError

if TYPE_CHECKING:
    from storage.cells.group import Group, Ids


class Codec(Protocol):
    """Turns what can be seen from the cells of a group into bytes and back."""

    def encode(self, sets: Sequence[Ids], group: Group) -> bytes:
        """Bytes of a set for each cell of a group: strictly increasing int64 ids (n,) out of the cell's cut."""
        ...

    def decode(self, data: bytes, group: Group) -> list[Ids]:
        """The sets again. Raises CorruptStoreError if the bytes make no sense."""
        ...


#: What stores call each codec, and the module that has its `CODEC`.
CODECS = {
    "contexts": "storage.cells.codecs.contexts",
    "gap-varint-zstd": "storage.cells.codecs.gap_varint",
    "delimiter": "storage.cells.codecs.delimiter",
}

#: The codec that new stores are written with.
DEFAULT = "contexts"


def codec_named(name: str) -> Codec:
    """The codec of that name. Raises StoreFormatError for an unknown one."""
    if name not in CODECS:
        raise StoreFormatError(f"the store uses the codec {name!r}; this vLOD knows {', '.join(CODECS)}")
    codec: Codec = importlib.import_module(CODECS[name]).CODEC
    return codec
