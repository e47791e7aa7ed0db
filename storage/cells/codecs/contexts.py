"""Each cell once, given its cut and the cells before it in its group: see `storage.cells.codecs.context_mixing`.

What was learnt of other models, the prior, ships with the code in `contexts_prior.bin`: a store holds none of it. Every
group starts from it, so that each can be read alone.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import zstandard
from numpy.typing import NDArray

from storage.base.errors import StoreFormatError
from storage.cells.codecs.context_mixing import (
    CONTEXTS,
    END,
    FINAL,
    HISTORY,
    NEAREST,
    OWN,
    SIZES,
    WEIGHTS,
    code,
    nearest_before,
)
from storage.cells.group import Group, Ids

PRIOR = Path(__file__).with_name("contexts_prior.bin")

#: The SHA-256 of that file. With another prior the same bytes mean something else: it needs another codec's name.
PRIOR_DIGEST = "594bb7a1e529ad71fec5618915f604557328c8dd414200bbfa47c3b29b143c3b"

#: What every probability starts from that nothing is known of: one half.
EVEN = 32768

_OTHERS = sum(SIZES)


@dataclass(frozen=True)
class Model:
    """What is learnt of decisions, and two tables: arrays as `context_mixing.code` takes them, but for the history."""

    probability: NDArray[np.int32]  # (sum of SIZES,)
    known: NDArray[np.uint8]  # (sum of SIZES,)
    weights: NDArray[np.int32]  # (WEIGHTS, CONTEXTS + 1)
    final: NDArray[np.int32]  # FINAL
    stretch: NDArray[np.int32]  # (4096,)
    squash: NDArray[np.int32]  # (2 * END + 1,)

    def to_bytes(self) -> bytes:
        """The model as a file holds it."""
        raw = [
            self.probability.astype("<u2"),
            self.known,
            self.weights.astype("<i4"),
            self.final.astype("<u2"),
            self.stretch.astype("<i2"),
            self.squash.astype("<u2"),
        ]
        return zstandard.ZstdCompressor(19).compress(b"".join(array.tobytes() for array in raw))

    @staticmethod
    def from_bytes(data: bytes) -> Model:
        """The reverse of `to_bytes`."""
        content, at = zstandard.ZstdDecompressor().decompress(data), 0
        arrays = []
        for kind, shape in (
            ("<u2", (_OTHERS,)),
            ("<u1", (_OTHERS,)),
            ("<i4", (WEIGHTS, CONTEXTS + 1)),
            ("<u2", FINAL),
            ("<i2", (4096,)),
            ("<u2", (2 * END + 1,)),
        ):
            size = int(np.prod(shape))
            arrays.append(np.frombuffer(content, kind, size, at).reshape(shape).copy())
            at += arrays[-1].nbytes
        probability, known, *rest = arrays
        return Model(probability.astype(np.int32), known, *(array.astype(np.int32) for array in rest))


@cache
def prior() -> Model:
    """The model that ships with the code. Raises StoreFormatError if its file is another one."""
    data = PRIOR.read_bytes()
    if hashlib.sha256(data).hexdigest() != PRIOR_DIGEST:
        raise StoreFormatError(f"{PRIOR} is not the one that stores are written with; install vLOD again")
    return Model.from_bytes(data)


class Coder:
    """Codes groups, each from the same model: by default from the prior."""

    def __init__(self, model: Model | None = None) -> None:
        self._given = model

    @property
    def _model(self) -> Model:
        return prior() if self._given is None else self._given

    def encode(self, sets: Sequence[Ids], group: Group) -> bytes:
        """Bytes of what can be seen from each cell of a group, increasing ids of its cut.

        Raises ValueError for a set that does not lie in its cut.
        """
        seen = np.concatenate([np.zeros(0, np.bool_), *map(np.isin, group.cuts, sets)])
        if seen.sum() != sum(len(ids) for ids in sets):
            raise ValueError("a cell sees what is not in its cut")
        data = np.zeros(4 * len(sets) * len(group.part.end) + 8, np.uint8)
        size, _, _ = self.run(group, seen, data, decoding=False)
        return data[:size].tobytes()

    def decode(self, data: bytes, group: Group) -> list[Ids]:
        """The sets again: of damaged bytes other parts of the cuts."""
        seen = np.zeros(len(group.part.cut), np.bool_)
        self.run(group, seen, np.frombuffer(data, np.uint8).copy(), decoding=True)
        parts = np.split(seen, group.cut_ends[:-1]) if group.count else []
        return [cut[part] for cut, part in zip(group.cuts, parts, strict=True)]

    def run(
        self, group: Group, seen: NDArray[np.bool_], data: NDArray[np.uint8], *, decoding: bool
    ) -> tuple[int, int, Model]:
        """Bytes and decisions of a group, and what the model has become: see `context_mixing.code`."""
        part, start = group.part, self._model
        before, own = sum(SIZES[:HISTORY]), OWN * len(part.end)
        probability = np.full(_OTHERS + own, EVEN, np.int32)
        known = np.zeros(_OTHERS + own, np.uint8)
        for whole, shared in ((probability, start.probability), (known, start.known)):
            whole[:before] = shared[:before]
            whole[before + own :] = shared[before:]
        weights, final = start.weights.copy(), start.final.copy()
        nearest = np.empty((len(group.cuts), NEAREST), np.int64)
        nearest_before(group.centres, nearest)
        size, made = code(
            decoding, part.end, part.parent, part.lo, part.hi, group.boxes, nearest, part.cut, group.cut_ends, seen,
            probability, known, weights, final, start.stretch, start.squash, data,
        )  # fmt: skip
        others = [np.concatenate([whole[:before], whole[before + own :]]) for whole in (probability, known)]
        return int(size), made, Model(others[0], others[1], weights, final, start.stretch, start.squash)


CODEC = Coder()
