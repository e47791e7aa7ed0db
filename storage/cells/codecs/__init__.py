"""Codecs for lists of drawable ids: one file a code, all behind `Codec`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from storage.base.errors import StoreFormatError
from storage.cells.codecs.gap_varint import GapVarint

Ids = NDArray[np.uint32]


class Codec(Protocol):
    """Turns lists of ids into bytes and back."""

    @property
    def name(self) -> str:
        """What the manifest calls this code."""
        ...

    def encode(self, lists: Sequence[Ids]) -> bytes:
        """Bytes of lists of strictly increasing ids, uint32 (n,) each; lists may be empty."""
        ...

    def decode(self, data: bytes) -> list[Ids]:
        """The lists again. Raises CorruptStoreError if the bytes make no sense."""
        ...


CODECS: dict[str, Codec] = {codec.name: codec for codec in (GapVarint(),)}

#: The code that new stores are written with.
DEFAULT = GapVarint.name


def codec_named(name: str) -> Codec:
    """The codec of that name. Raises StoreFormatError for an unknown one."""
    if name not in CODECS:
        raise StoreFormatError(f"the store uses the code {name!r}; this vLOD knows {', '.join(sorted(CODECS))}")
    return CODECS[name]
