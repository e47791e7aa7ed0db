"""What can be seen from a group of cells as a stream of decisions, each foretold by contexts: the inner loop.

Going down the hierarchy of each cell, one decision a node that has more than one node of the cut below it, "is anything
below seen?", and at nodes of the cut "is it seen?". Seven contexts foretell each: what the nearest cells before it in
the group saw there, what was decided of the node's siblings, how far it is for its size. Their probabilities are
mixed in the logistic domain, corrected by a table, and steer a binary range coder.

Whole numbers throughout but for two comparisons of boxes, whose sums and products are of float64, no two fused and all
factors powers of two: the same bits on every machine. All functions read and write within the arrays they are given,
whatever the bytes say.

Based on: M. Mahoney, Adaptive Weighing of Context Models for Lossless Data Compression, Florida Tech CS-2005-16, 2005
(mixing, the final table); M. Schindler, A Fast Renormalisation for Arithmetic Coding, DCC 1998; Subbotin, Carryless
Rangecoder, 1999.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from storage.base.kernels import allocating_kernel, kernel

#: Contexts of a decision, and the entries of each but that of the node's own history, which has OWN a node.
CONTEXTS = 7
SIZES = (3750, 1600, 6000, 0, 6400, 5000, 490)
HISTORY = 3
OWN = 4

#: Sets of mixing weights; rows and columns of the final table.
WEIGHTS = 50
FINAL = (250, 33)

#: Most cells before one that foretell it.
NEAREST = 6

#: A context's probability moves by at least about one part in so many.
SLOWEST = 120

#: A node as another cell saw it: hidden, seen itself, something below seen, something above seen; no such cell.
HIDDEN, SEEN, SEEN_BELOW, SEEN_ABOVE, NOT_KNOWN = 0, 1, 2, 3, 4

#: The logistic domain in steps of 1/256: from -END to END.
END = 2560


@kernel()
def nearest_before(centres: NDArray[np.int64], nearest: NDArray[np.int64]) -> None:
    """For each cell the NEAREST cells before it, the nearest first, of equally near ones the last first.

    centres (g, 3) int64: of the cells, in half edges of the finest; nearest (g, NEAREST) int64: filled, -1 where there
    are not as many.
    """
    for cell in range(len(centres)):
        found = 0
        nearest[cell, :] = -1
        for before in range(cell - 1, -1, -1):
            distance2 = _distance2(centres, cell, before)
            at = found
            while at > 0 and _distance2(centres, cell, nearest[cell, at - 1]) > distance2:
                at -= 1
            if at < NEAREST:
                last = min(found, NEAREST - 1)
                for k in range(last, at, -1):
                    nearest[cell, k] = nearest[cell, k - 1]
                nearest[cell, at] = before
                found = min(found + 1, NEAREST)


@kernel()
def _distance2(centres: NDArray[np.int64], a: int, b: int) -> np.int64:
    x, y, z = centres[a, 0] - centres[b, 0], centres[a, 1] - centres[b, 1], centres[a, 2] - centres[b, 2]
    return x * x + y * y + z * z


@kernel()
def _nearness(lo: NDArray[np.float64], hi: NDArray[np.float64], cell: NDArray[np.float64], node: np.int64) -> int:
    """Distance over size in eight steps, 0 where the boxes touch; lo, hi (n, 3): of the nodes; cell (2, 3)."""
    distance2, size2 = 0.0, 0.0
    for axis in range(3):
        gap = max(lo[node, axis] - cell[1, axis], cell[0, axis] - hi[node, axis])
        if gap > 0:
            distance2 += gap * gap
        edge = hi[node, axis] - lo[node, axis]
        size2 += edge * edge
    if distance2 <= 0:
        return 0
    step, bound = 1, 0.25
    while step < 7 and distance2 >= size2 * bound:
        step += 1
        bound *= 4.0 if step < 5 else 8.0
    return step


@kernel()
def _ahead(lo: NDArray[np.float64], hi: NDArray[np.float64], here: NDArray[np.float64], there: NDArray[np.float64],
           node: np.int64) -> int:  # fmt: skip
    """1 where the way from the cell `there` to the cell `here` (2, 3) leads towards the node, else 2."""
    along = 0.0
    for axis in range(3):
        middle = here[0, axis] + here[1, axis]
        step = middle - (there[0, axis] + there[1, axis])
        along += step * ((lo[node, axis] + hi[node, axis]) - middle)
    return 1 if along > 0 else 2


@allocating_kernel()
def code(
    decoding: bool,
    end: NDArray[np.int64],
    parent: NDArray[np.int64],
    lo: NDArray[np.float64],
    hi: NDArray[np.float64],
    boxes: NDArray[np.float64],
    nearest: NDArray[np.int64],
    cut: NDArray[np.int64],
    cut_ends: NDArray[np.int64],
    seen: NDArray[np.bool_],
    probability: NDArray[np.int32],
    known: NDArray[np.uint8],
    weights: NDArray[np.int32],
    final: NDArray[np.int32],
    stretch: NDArray[np.int32],
    squash: NDArray[np.int32],
    data: NDArray[np.uint8],
) -> tuple[np.int64, int]:
    """Codes a group of cells, one after the other: how many bytes and how many decisions it took.

    Args:
        decoding: `seen` is written from `data`; otherwise `data` is written from `seen`.
        end, parent: (n,) of the nodes, see NODE; every end lies beyond its node and is at most n; parent -1 of roots.
        lo, hi: (n, 3) boxes of the nodes, model units.
        boxes: (g, 2, 3) boxes of the cells, model units.
        nearest: (g, NEAREST), see `nearest_before`.
        cut, cut_ends: the nodes (c,) of the cells' cuts, increasing for each cell; where those of each cell end (g,).
        seen: (c,) which of them can be seen.
        probability, known: of all contexts' entries, the sum of SIZES with OWN * n in the place of HISTORY: 16 bits
            each, and how often each was met. Both, `weights` (WEIGHTS, CONTEXTS + 1), 16 fractional bits, and `final`
            (FINAL), 16 bits, are learnt on.
        stretch, squash: (4096,) ln(p / (1 - p)) of probabilities, 8 fractional bits; (2 * END + 1,) its reverse, 16.
        data: read from the start, as if followed by zeros; or written, and then long enough: four bytes a node and
            cell.
    """
    cells, count = len(nearest), len(end)
    starts = np.zeros(CONTEXTS, np.int64)
    for k in range(1, CONTEXTS):
        starts[k] = starts[k - 1] + (OWN * count if k - 1 == HISTORY else SIZES[k - 1])
    state = np.zeros((cells, count), np.uint8)
    at_cut = np.zeros(count, np.int64)  # which of the cell's cut a node is, plus 1
    below, visible = np.zeros(count + 1, np.int32), np.zeros(count + 1, np.int32)
    siblings = np.zeros(count, np.uint8)  # of each parent: none decided, all hidden, all seen, both
    surprises = np.zeros(count, np.uint8)  # of each parent: children that differ from the nearest cell, 3 at most
    entry, signal = np.zeros(CONTEXTS, np.int64), np.zeros(CONTEXTS + 1, np.int64)
    around = np.zeros(NEAREST, np.int64)
    low, high, value = np.int64(0), np.int64(0xFFFFFFFF), np.int64(0)
    at = np.int64(0)
    if decoding:
        for _ in range(4):
            value = (value << 8) | (np.int64(data[at]) if at < len(data) else np.int64(0))
            at += 1
    made, first = 0, np.int64(0)
    for cell in range(cells):
        at_cut[:] = 0
        siblings[:] = 0
        surprises[:] = 0
        for k in range(first, cut_ends[cell]):
            at_cut[cut[k]] = k + 1
        for n in range(count):
            own = at_cut[n]
            below[n + 1] = below[n] + (1 if own else 0)
            if not decoding:
                visible[n + 1] = visible[n] + (1 if own and seen[own - 1] else 0)
        past = np.int64(0)
        nearest_one = nearest[cell, 0]
        node = np.int64(0)
        while node < count:
            leaf = at_cut[node] > 0
            if not leaf and below[end[node]] - below[node] <= 1:
                node += 1
                continue
            above = parent[node]
            have = some = 0
            for k in range(NEAREST):
                other = nearest[cell, k]
                around[k] = state[other, node] if other >= 0 else NOT_KNOWN
                if other >= 0:
                    have += 1
                    some += around[k] > 0
            beside = np.int64(siblings[above]) if above >= 0 else np.int64(0)
            surprise = np.int64(surprises[above]) if above >= 0 else np.int64(0)
            near = _nearness(lo, hi, boxes[cell], node)
            ahead = _ahead(lo, hi, boxes[cell], boxes[nearest_one], node) if nearest_one >= 0 else 0
            following = end[node]
            after = np.int64(state[nearest_one, following]) if nearest_one >= 0 and following < count else np.int64(4)
            over = np.int64(state[nearest_one, above]) if nearest_one >= 0 and above >= 0 else np.int64(4)
            a, b, c = around[0], around[1], around[2]
            far = 2
            if around[4] == 0 and around[5] == 0:
                far = 0
            elif (around[4] == 0 or around[4] == 4) and (around[5] == 0 or around[5] == 4):
                far = 1
            kind = 1 if leaf else 0
            head = kind * 5 + a
            entry[0] = (((head * 5 + b) * 5 + c) * 5 + around[3]) * 3 + far
            entry[1] = ((head * 5 + b) * 8 + (past & 7)) * 4 + beside
            entry[2] = (((head * 8 + near) * 3 + ahead) * 5 + b) * 5 + c
            entry[3] = node * OWN + (0 if a == 0 else 1 if a < 4 else 2)
            entry[4] = (((head * 4 + beside) * 4 + surprise) * 8 + near) * 5 + over
            entry[5] = (((head * 5 + b) * 5 + after) * 5 + over) * 4 + beside
            entry[6] = ((some * 7 + have) * 2 + kind) * 5 + a
            mixer = head * 5 + b
            total = np.int64(0)
            for k in range(CONTEXTS):
                entry[k] += starts[k]
                signal[k] = stretch[probability[entry[k]] >> 4]
                total += signal[k] * weights[mixer, k]
            signal[CONTEXTS] = 64
            total += 64 * np.int64(weights[mixer, CONTEXTS])
            mixed = np.int64(min(max(total >> 16, np.int64(1 - END)), np.int64(END - 1)))
            guess = np.int64(squash[mixed + END])
            row = mixer * 5 + c
            place = (mixed + END) * 32
            column = place // (2 * END)
            part = place - column * 2 * END
            refined = (final[row, column] * (2 * END - part) + final[row, column + 1] * part) // (2 * END)
            chance = min(max((guess + refined) >> 1, np.int64(12)), np.int64(65524))
            span = high - low
            middle = low + (span >> 16) * chance + (((span & 0xFFFF) * chance) >> 16)
            if decoding:
                bit = np.int64(1 if value <= middle else 0)
            elif leaf:
                bit = np.int64(seen[at_cut[node] - 1])
            else:
                bit = np.int64(1 if visible[end[node]] > visible[node] else 0)
            if bit:
                high = middle
            else:
                low = middle + 1
            while (low ^ high) >> 24 == 0:
                if decoding:
                    more = np.int64(data[at]) if at < len(data) else np.int64(0)
                    value = ((value << 8) & 0xFFFFFFFF) | more
                else:
                    data[at] = high >> 24
                at += 1
                low = (low << 8) & 0xFFFFFFFF
                high = ((high << 8) & 0xFFFFFFFF) | 255
            made += 1
            error = ((bit << 16) - guess) * 10
            for k in range(CONTEXTS + 1):
                weights[mixer, k] += (signal[k] * error + (1 << 17)) >> 18
            for k in range(CONTEXTS):
                e = entry[k]
                met = np.int64(known[e])
                was = np.int64(probability[e])
                # 655360 / (10 n + 16): one part in n + 1.6
                moved = was + (((bit * 65535 - was) * (655360 // (10 * met + 16))) >> 16)
                probability[e] = min(max(moved, np.int64(16)), np.int64(65519))
                if met < SLOWEST:
                    known[e] = met + 1
            target = bit * 65535
            final[row, column] += (target - final[row, column]) // 48
            final[row, column + 1] += (target - final[row, column + 1]) // 48
            if nearest_one >= 0:
                differs = (bit == 1) != (a > 0)
                past = (past << 1) | (1 if differs else 0)
                if above >= 0 and differs and surprises[above] < 3:
                    surprises[above] += 1
            if above >= 0:
                if siblings[above] == 0:
                    siblings[above] = 2 if bit else 1
                elif siblings[above] == (1 if bit else 2):
                    siblings[above] = 3
            if leaf:
                if decoding:
                    seen[at_cut[node] - 1] = bit == 1
                node = end[node]
            elif bit:
                node += 1
            else:
                node = end[node]
        for n in range(count):
            above = parent[n]
            if at_cut[n] and seen[at_cut[n] - 1]:
                state[cell, n] = SEEN
            elif above >= 0 and (state[cell, above] == SEEN or state[cell, above] == SEEN_ABOVE):
                state[cell, n] = SEEN_ABOVE
        for n in range(count - 1, -1, -1):
            above = parent[n]
            if above >= 0 and state[cell, above] == HIDDEN and 0 < state[cell, n] < SEEN_ABOVE:
                state[cell, above] = SEEN_BELOW
        first = cut_ends[cell]
    if not decoding:
        data[at] = high >> 24  # with the zeros after it, above low and not above high
        at += 1
        while at > 0 and data[at - 1] == 0:
            at -= 1
    return at, made
