"""What a store holds, as facts that JSON can say."""

from __future__ import annotations

from typing import Any

import numpy as np

from storage.base.typed_json import to_json
from storage.model.tree import leaves
from storage.shards.manifest import FILE
from storage.shards.shards import Kind
from storage.store import Store

#: How many of the cells with the largest gaps are named.
WORST = 5

#: Where the bins of the histogram of cells by tightness begin; cells of which nothing is proven are in the last one.
BINS = (1.0, 1.1, 1.25, 1.5, 2.0, 3.0, 5.0, 10.0)

#: What the kinds of frames are called; others, of sections that this code does not know, are counted together.
_KINDS = {
    Kind.GEOMETRY: "meshes",
    Kind.SOURCE_FACES: "source faces",
    Kind.TABLE: "tables",
    Kind.NAMES: "names",
    Kind.CELLS: "what is seen from cells",
}
_OTHER_KINDS = "frames of other kinds"


def collect(store: Store) -> dict[str, Any]:
    """All facts about a store, as JSON holds them. Lengths in model units, sizes in bytes, errors in model units."""
    manifest = store.manifest
    return {
        "store": store.files.url,
        "format": manifest.format,
        "version": manifest.version,
        "model": to_json(manifest.model),
        "parameters": dict(manifest.parameters),
        "approximation": manifest.approximation,
        "pixel_angle": manifest.pixel_angle,
        "counts": manifest.counts,
        "see_through": _see_through(store),
        "levels": _levels(store),
        "cells": _cells(store),
        "bytes": _bytes(store),
    }


def _levels(store: Store) -> list[dict[str, Any]]:
    """The levels of leaves, and then those of the nodes above them, which stand for much and are seen from afar.

    allowed_from: the distances, in model units, from which their errors are allowed by the build's pixel error.
    """
    rows = store.drawables
    leaf = leaves(store.nodes)[rows["node"]]
    allowed = float(store.manifest.parameters.get("pixel_error", 1.0)) * store.manifest.pixel_angle
    found = []
    for of, among in (("leaves", rows[leaf]), ("nodes above", rows[~leaf])):
        for level in np.unique(among["level"]).tolist():
            own = among[among["level"] == level]
            median, largest = float(np.median(own["error"])), float(own["error"].max())
            found.append(
                {
                    "of": of,
                    "level": level,
                    "drawables": len(own),
                    "triangles": int(own["triangles"].sum(dtype=np.int64)),
                    "median_error": median,
                    "largest_error": largest,
                    "median_allowed_from": median / allowed + median,
                    "largest_allowed_from": largest / allowed + largest,
                }
            )
    return found


def _see_through(store: Store) -> dict[str, int]:
    """How many drawables can be seen through, and their triangles."""
    own = store.drawables[store.drawables["see_through"]]
    return {"drawables": len(own), "triangles": int(own["triangles"].sum(dtype=np.int64))}


def _cells(store: Store) -> dict[str, Any]:
    cells = store.cells[store.cells["computed"]]
    if not len(cells):
        return {"cells": len(store.cells), "computed": 0}
    numbers = np.flatnonzero(store.cells["computed"])
    depths, counts = np.unique(cells["depth"], return_counts=True)
    edges = (cells["hi"] - cells["lo"])[:, 0]
    reported, proven = (cells[name].astype(np.int64) for name in ("triangles", "proven_triangles"))
    worst = np.lexsort((numbers, proven - reported))[:WORST]
    worst = worst[reported[worst] > proven[worst]]
    target = store.manifest.parameters.get("triangles_per_cell")
    return {
        "cells": len(store.cells),
        "computed": len(cells),
        "above_target": None if target is None else int((reported > int(target)).sum()),
        "depths": {str(depth): int(count) for depth, count in zip(depths, counts, strict=True)},
        "smallest_edge": float(edges.min()),
        "largest_edge": float(edges.max()),
        "median_drawables": float(np.median(cells["drawables"])),
        "median_triangles": float(np.median(reported)),
        "largest_triangles": int(reported.max()),
        "cut_triangles": int(cells["cut_triangles"].sum(dtype=np.int64)),
        "cut_drawables": int(cells["cut_drawables"].sum(dtype=np.int64)),
        "reported_triangles": int(reported.sum()),
        "proven_triangles": int(proven.sum()),
        "turned_triangles": int(cells["turned_triangles"].sum(dtype=np.int64)),
        "turned_share": float(np.mean(cells["turned_triangles"] / np.maximum(reported, 1))),
        "reported_drawables": int(cells["drawables"].sum(dtype=np.int64)),
        "proven_drawables": int(cells["proven_drawables"].sum(dtype=np.int64)),
        "tightness": _ratio(reported.sum(), proven.sum()),
        "hold_out_rays": int(cells["hold_out_rays"].sum(dtype=np.int64)),
        "missed_rays": int(cells["missed_rays"].sum(dtype=np.int64)),
        "histogram": _histogram(reported, proven),
        "worst": [
            {
                "cell": int(numbers[at]),
                "lo": cells["lo"][at].tolist(),
                "hi": cells["hi"][at].tolist(),
                "reported_triangles": int(reported[at]),
                "proven_triangles": int(proven[at]),
                "cut_triangles": int(cells["cut_triangles"][at]),
                "reported_drawables": int(cells["drawables"][at]),
                "proven_drawables": int(cells["proven_drawables"][at]),
                "cut_drawables": int(cells["cut_drawables"][at]),
                "tightness": _ratio(reported[at], proven[at]),
            }
            for at in worst.tolist()
        ],
        "raised": _raised(store, numbers),
    }


def _histogram(reported: np.ndarray, proven: np.ndarray) -> list[dict[str, Any]]:
    """How many cells are how tight, by triangles (n,) reported and proven visible; `to` is None in the last bin."""
    bound = np.full(len(reported), np.inf)
    bound[reported == proven] = 1.0
    np.divide(reported, proven, out=bound, where=proven > 0)
    counts = np.bincount(np.searchsorted(BINS, bound, side="right") - 1, minlength=len(BINS)).tolist()
    return [
        {"from": low, "to": high, "cells": count}
        for low, high, count in zip(BINS, (*BINS[1:], None), counts, strict=True)
    ]


def _raised(store: Store, numbers: np.ndarray) -> list[dict[str, Any]]:
    """Those of some cells whose pixel error was raised to keep --max-triangles or --memory, the largest error first."""
    built_for = np.float32(store.manifest.parameters.get("pixel_error", 1.0))
    errors = store.cells["pixel_error"][numbers]
    order = np.lexsort((numbers, -errors))
    return [
        {
            "cell": cell,
            "lo": store.cells["lo"][cell].tolist(),
            "hi": store.cells["hi"][cell].tolist(),
            "pixel_error": float(store.cells["pixel_error"][cell]),
            "reported_triangles": int(store.cells["triangles"][cell]),
        }
        for cell in numbers[order[errors[order] > built_for]].tolist()
    ]


def _bytes(store: Store) -> dict[str, Any]:
    kinds = store.bytes_by_kind()
    named = {label: kinds[kind] for kind, label in _KINDS.items() if kind in kinds}
    if others := sum(size for kind, size in kinds.items() if kind not in _KINDS):
        named[_OTHER_KINDS] = others
    sizes = {record.name: record.bytes for _, record in store.manifest.shards()}
    shards = sum(sizes.values())
    manifest = store.files.size(FILE) or 0
    computed = int(store.cells["computed"].sum())
    triangles = store.manifest.counts["stored_triangles"]
    return {
        "manifest": manifest,
        **named,
        "indices and checksums": shards - sum(named.values()),
        "total": shards + manifest,
        "shards": len(sizes),
        "per_cell": _ratio(kinds.get(Kind.CELLS, 0), computed),
        "per_stored_triangle": _ratio(kinds.get(Kind.GEOMETRY, 0), triangles),
    }


def _ratio(above: float, below: float) -> float | None:
    return float(above) / float(below) if below else None
