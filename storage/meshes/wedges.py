"""Which vertex each corner of a triangle uses, where several vertices share a position (at creases and colour seams).

The vertices at one position are its wedges. Each corner is coded by how long ago its wedge was last used at its
position: 0: a new wedge, 1: the wedge used last, 2: the one before, and so on. A position's first corner has a new
wedge and no code.

Based on: Isenburg and Snoeyink, Face Fixer: Compressing Polygon Meshes with Properties, SIGGRAPH 2000, section 5
(corners' attributes coded around vertices); the move-to-front rule is Bentley et al., CACM 29(4), 1986.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from storage.base.kernels import allocating_kernel

#: Codes above this do not exist; a wedge that was last used longer ago is stored again.
LARGEST = 255


@allocating_kernel()
def encode_wedges(
    corners: NDArray[np.uint32], vertices: NDArray[np.uint32], positions: int
) -> tuple[NDArray[np.uint8], NDArray[np.uint32], NDArray[np.uint32]]:
    """Codes (k,) uint8 of corners, their wedges (c,) uint32 by first use, and the vertex (w,) uint32 of each wedge.

    corners: position of each corner (c,), below `positions`; vertices: its vertex (c,); a vertex has one position.
    """
    newest = np.full(positions, -1, np.int64)
    older = np.full(len(corners), -1, np.int64)
    codes = np.empty(len(corners), np.uint8)
    wedges = np.empty(len(corners), np.uint32)
    sources = np.empty(len(corners), np.uint32)
    coded = 0
    used = 0
    for c in range(len(corners)):
        place = np.int64(corners[c])
        fresh_place = newest[place] < 0
        before = np.int64(-1)
        wedge = newest[place]
        age = 1
        while wedge >= 0 and sources[wedge] != vertices[c] and age <= LARGEST:
            before = wedge
            wedge = older[wedge]
            age += 1
        if wedge < 0 or age > LARGEST:
            wedge = used
            used += 1
            sources[wedge] = vertices[c]
            older[wedge] = newest[place]
            newest[place] = wedge
            age = 0
        elif before >= 0:
            older[before] = older[wedge]
            older[wedge] = newest[place]
            newest[place] = wedge
        if not fresh_place:
            codes[coded] = age
            coded += 1
        wedges[c] = wedge
    return codes[:coded].copy(), wedges, sources[:used].copy()


@allocating_kernel()
def decode_wedges(
    corners: NDArray[np.uint32], codes: NDArray[np.uint8], positions: int, count: int
) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
    """The wedge (c,) uint32 of each corner and the position (count,) uint32 of each wedge.

    corners: position of each corner (c,), below `positions`; count: how many wedges there are. Raises ValueError for
    codes that make no sense.
    """
    newest = np.full(positions, -1, np.int64)
    older = np.full(count, -1, np.int64)
    wedges = np.empty(len(corners), np.uint32)
    places = np.empty(count, np.uint32)
    coded = 0
    used = 0
    for c in range(len(corners)):
        place = np.int64(corners[c])
        age = np.int64(0)
        if newest[place] >= 0:
            if coded >= len(codes):
                raise ValueError("the codes of wedges end too soon")
            age = np.int64(codes[coded])
            coded += 1
        wedge = newest[place]
        if age == 0:
            if used >= count:
                raise ValueError("there are more wedges than vertices")
            wedge = used
            used += 1
            places[wedge] = place
            older[wedge] = newest[place]
            newest[place] = wedge
        elif age > 1:
            before = np.int64(-1)
            for _ in range(age - 1):
                before = wedge
                wedge = older[wedge]
                if wedge < 0:
                    raise ValueError("a wedge does not exist")
            older[before] = older[wedge]
            older[wedge] = newest[place]
            newest[place] = wedge
        wedges[c] = wedge
    if used != count or coded != len(codes):
        raise ValueError("codes of wedges are left over")
    return wedges, places
