"""What leaving out facets that turn their backs saves, and what it costs the player.

    python tests/benchmarks/measure_back_faces.py STORE ... [--cells 40] [--json OUT.json]

Cells are chosen at random. Turned away: part of a vLOD's triangles in facets that the cell can only see from behind,
the mean over cells; beside it that of all single triangles that it can only see from behind, the most that any facets
could save. Commands and calls: to draw a whole vLOD, without and with facets left out; calls are those of OpenGL 3.3,
newer ones need one for all. Milliseconds: to make these commands, the median. Loading: microseconds a triangle to find
the facets of a mesh, beside those to decode it. Nothing is drawn.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from player.renderer.draw_list import DrawList, build, draw_tables
from player.renderer.facet_table import CellBox, FacetTable, PackFacets
from player.renderer.surfaces import draw_calls
from storage import open_store
from storage.meshes.facets import part_meshes
from storage.store import Store


@dataclass(frozen=True)
class Finding:
    """What was found in the cells of a store."""

    store: str
    cells: int
    triangles: float  # of a vLOD, mean
    one_sided: float  # part of them in drawables of which only fronts count
    turned: float  # part of them in facets that are turned away
    single: float  # part of them that are turned away, one by one
    facets: int  # in the store
    meshes: int
    commands: tuple[float, float]  # mean, without and with facets left out
    calls: tuple[float, float]
    milliseconds: tuple[float, float]
    decoding: float  # microseconds a triangle
    parting: float


def load(store: Store) -> tuple[FacetTable, float, float]:
    """The facets of all meshes, and the seconds that decoding and parting them took."""
    table = FacetTable(len(store.geometry))
    times = np.zeros(2)
    for number in range(len(store.packs)):
        meshes = np.flatnonzero(store.geometry["pack"] == number)
        meshes = meshes[np.argsort(store.geometry["vertex_start"][meshes], kind="stable")]
        rows = store.geometry[meshes]
        sizes = rows["vertices"].astype(np.int64), rows["triangles"].astype(np.int64)
        began = time.perf_counter()
        pack = store.pack(number)
        decoded = time.perf_counter()
        _, counts, facets, cones = part_meshes(pack.positions, pack.triangles, *sizes, store.one_sided[meshes])
        times += decoded - began, time.perf_counter() - decoded
        table.add(number, meshes, PackFacets(counts, facets, cones))
    return table, float(times[0]), float(times[1])


def count_turned(store: Store, ids: np.ndarray, lo: np.ndarray, hi: np.ndarray) -> int:
    """Triangles of one-sided drawables of which a whole cell can only see the back."""
    surfaces = store.surfaces(ids[store.drawables["one_sided"][ids]])
    a, b, c = (surfaces.points[surfaces.triangles[:, k]].astype(np.float64) for k in range(3))
    normal = np.cross(b - a, c - a)
    nearest = np.where(normal > 0, hi / store.grid.step, lo / store.grid.step) - a
    return int(((nearest * normal).sum(axis=1) < 0).sum())


def timed(work: Callable[[], DrawList]) -> tuple[DrawList, float]:
    """What some work gives, and the milliseconds of the second time."""
    work()
    began = time.perf_counter()
    return work(), 1000 * (time.perf_counter() - began)


def measure(path: str, count: int) -> Finding:
    """Cells of a store."""
    load(open_store(path))  # compiles
    store = open_store(path)
    table, decoding, parting = load(store)
    tables = draw_tables(store.drawables, store.geometry, store.instances, store.grid.step)
    stored = int(store.geometry["triangles"].sum(dtype=np.int64))
    sizes = 3 * store.packs["triangles"].astype(np.int64)
    arena = np.zeros(len(store.packs), np.int32), np.cumsum(sizes) - sizes, table
    cells = np.random.default_rng(0).permutation(np.flatnonzero(store.cells["computed"]))[:count]
    rows: list[tuple[float, ...]] = []
    for cell in cells.tolist():
        row, ids = store.cells[cell], store.vlod(cell)
        box = CellBox(row["lo"], row["hi"])
        whole, before = timed(lambda ids=ids: build(ids, tables, *arena, None))  # type: ignore[misc]
        rest, after = timed(lambda ids=ids, box=box: build(ids, tables, *arena, box))  # type: ignore[misc]
        most = max(1, whole.triangles)
        closed = store.drawables["one_sided"][ids]
        rows.append(
            (
                whole.triangles, store.drawables["triangles"][ids[closed]].sum() / most, rest.turned / most,
                count_turned(store, ids, row["lo"], row["hi"]) / most, len(whole.commands), len(rest.commands),
                len(draw_calls(whole)), len(draw_calls(rest)), before, after,
            )
        )  # fmt: skip
    mean, median = np.mean(rows, axis=0).tolist(), np.median(rows, axis=0).tolist()
    return Finding(
        store=path,
        cells=len(cells),
        triangles=mean[0],
        one_sided=mean[1],
        turned=mean[2],
        single=mean[3],
        facets=int(table.count.sum()),
        meshes=len(table.count),
        commands=(mean[4], mean[5]),
        calls=(mean[6], mean[7]),
        milliseconds=(median[8], median[9]),
        decoding=1e6 * decoding / stored,
        parting=1e6 * parting / stored,
    )


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("stores", nargs="+")
    parser.add_argument("--cells", type=int, default=40)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows: list[dict[str, Any]] = []
    print("store | triangles of a vLOD, one-sided | turned away, single triangles | commands | calls | ms | loading")
    for path in arguments.stores:
        found = measure(path, arguments.cells)
        rows.append(asdict(found))
        print(
            f"{found.store} | {found.triangles:,.0f}, {100 * found.one_sided:.0f} % | {100 * found.turned:.1f} %, "
            f"{100 * found.single:.1f} % | {found.commands[0]:.0f}, {found.commands[1]:.0f} | "
            f"{found.calls[0]:.0f}, {found.calls[1]:.0f} | {found.milliseconds[0]:.2f}, {found.milliseconds[1]:.2f} | "
            f"{found.parting:.2f}, {found.decoding:.2f}",
            flush=True,
        )
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
