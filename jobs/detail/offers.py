"""Offers between tasks: what nodes give their parents, which of it is worth its place, and all of it as a file."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from jobs.detail.node import Locks, Offer

_NUMBERS = np.dtype(
    [("points", "<i8"), ("triangles", "<i8"), ("locks", "<i8"), ("error", "<f8"), ("lost", "<f8"), ("outward", "?")]
)


def affordable(offers: Sequence[Offer], triangles: int, placements: int) -> list[Offer]:
    """What a leaf that is placed several times offers each of its parents: finest first, as `offers` are.

    What it gives to all of them together has no more triangles than the leaf itself, which is stored once: else what is
    made from the copies would soon outgrow what they are copies of. The coarsest offer stays in any case.
    """
    few = [offer for offer in offers if len(offer.triangles) * placements <= triangles]
    return few or list(offers[-1:])


def save_offers(path: Path, nodes: Sequence[Sequence[Offer]]) -> None:
    """Write the offers of some nodes, in their order."""
    there = [offer for offers in nodes for offer in offers]
    numbers = np.zeros(len(there), _NUMBERS)
    for row, offer in zip(numbers, there, strict=True):
        row["points"], row["triangles"] = len(offer.points), len(offer.triangles)
        row["locks"], row["outward"] = len(offer.locks.points), offer.outward
        row["error"], row["lost"] = offer.error, offer.lost
    np.savez(
        path,
        nodes=np.array([len(offers) for offers in nodes], np.int64),
        numbers=numbers,
        points=np.concatenate([np.zeros((0, 3), np.int32), *(o.points for o in there)]),
        triangles=np.concatenate([np.zeros((0, 3), np.int32), *(o.triangles for o in there)]),
        colours=np.concatenate([np.zeros((0, 4), np.uint8), *(o.colours for o in there)]),
        lock_points=np.concatenate([np.zeros((0, 3), np.int32), *(o.locks.points for o in there)]),
        lock_first=np.concatenate([np.zeros(0, np.int64), *(o.locks.first for o in there)]),
        lock_last=np.concatenate([np.zeros(0, np.int64), *(o.locks.last for o in there)]),
    )


def load_offers(path: Path) -> list[list[Offer]]:
    """Offers that were saved, node by node."""
    with np.load(path) as saved:
        arrays = {name: saved[name] for name in saved.files}
    found: list[list[Offer]] = []
    point = triangle = lock = 0
    rows = iter(arrays["numbers"])
    for count in arrays["nodes"].tolist():
        found.append([])
        for row in islice(rows, count):
            points, triangles, locks = int(row["points"]), int(row["triangles"]), int(row["locks"])
            found[-1].append(
                Offer(
                    arrays["points"][point : point + points],
                    arrays["triangles"][triangle : triangle + triangles],
                    arrays["colours"][3 * triangle : 3 * (triangle + triangles)],
                    float(row["error"]),
                    float(row["lost"]),
                    bool(row["outward"]),
                    Locks(*(arrays[f"lock_{name}"][lock : lock + locks] for name in ("points", "first", "last"))),
                )
            )
            point, triangle, lock = point + points, triangle + triangles, lock + locks
    return found
