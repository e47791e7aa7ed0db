"""`vlod info` as a user runs it."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from storage.cells.octree import Octree
from storage.cli.text import length
from storage.known_cells import KnownCells
from storage.model.tree import leaves
from storage.shards.manifest import commit
from storage.store import Store
from storage.vlod_writer import cells_section, write_cell_shard
from tests.storage.tiny_store import make_store, room_parts


def _vlod(*args: object) -> subprocess.CompletedProcess:
    program = Path(sys.executable).with_name("vlod")
    return subprocess.run([str(program), *map(str, args)], capture_output=True, text=True, check=False)


def test_info_of_a_store(tmp_path: Path) -> None:
    store = make_store(tmp_path / "room.store", room_parts())
    done = _vlod("info", tmp_path / "room.store")
    assert done.returncode == 0
    assert done.stderr == ""
    assert "3,840 triangles in 12 parts" in done.stdout
    facts = json.loads(_vlod("info", tmp_path / "room.store", "--json").stdout)
    assert facts["cells"]["computed"] == 64
    turned, triangles = (store.cells[name].astype(np.int64) for name in ("turned_triangles", "triangles"))
    assert facts["cells"]["turned_triangles"] == turned.sum() > 0
    assert facts["cells"]["turned_share"] == pytest.approx((turned / triangles).mean())
    assert f"{100 * (turned / triangles).mean():.1f} % of a vLOD's triangles" in done.stdout


def test_info_tells_errors_in_units_and_from_where_they_are_allowed(tmp_path: Path) -> None:
    store = make_store(tmp_path / "room.store", room_parts(), pixel_error=2.0)
    facts = json.loads(_vlod("info", tmp_path / "room.store", "--json").stdout)
    leaf = leaves(store.nodes)[store.drawables["node"]]
    levels = {(row["of"], row["level"]): row for row in facts["levels"]}
    assert sum(row["drawables"] for row in levels.values()) == len(store.drawables)
    assert list(levels) == sorted(levels)  # leaves first
    allowed = 2.0 * store.manifest.pixel_angle
    for (of, level), row in levels.items():
        rows = store.drawables[(leaf == (of == "leaves")) & (store.drawables["level"] == level)]
        error = float(rows["error"].max())
        assert (row["drawables"], row["largest_error"]) == (len(rows), error)
        assert error == pytest.approx(allowed * (row["largest_allowed_from"] - error))
    lines = [line.split() for line in _vlod("info", tmp_path / "room.store").stdout.splitlines()]
    told = next(line for line in lines if line[:2] == ["leaves,", "0"])
    metres = levels["leaves", 0]["largest_allowed_from"] * store.manifest.model.unit_in_metres
    number, unit = told[-2:]
    assert float(number.replace(",", "")) * {"km": 1e3, "m": 1, "mm": 1e-3, "µm": 1e-6}[unit] == pytest.approx(
        metres, rel=0.01
    )


@pytest.mark.parametrize(
    ("metres", "told"),
    [(0, "0 µm"), (4.21e-7, "0.421 µm"), (9.999e-4, "1 mm"), (0.0357, "35.7 mm"), (357, "357 m"), (2.5e6, "2,500 km")],
)
def test_lengths_are_told_in_the_unit_that_suits_them(metres: float, told: str) -> None:
    assert length(metres) == told


def test_info_tells_how_tight_cells_are_and_which_are_the_worst(tmp_path: Path) -> None:
    """What is reported, and how much of it is proven, differs from cell to cell."""
    store = make_store(tmp_path / "room.store", room_parts(), depth=1, visible=lambda _g, _c, cut: cut[:-2])
    rows = store.cells.copy()
    rows["proven_triangles"] = (rows["triangles"] / np.array([1, 1, 1.05, 1.2, 1.4, 1.9, 2.5, 20])).astype(np.int64)
    rows["proven_triangles"][1] = 0
    rewrite_cells(store, rows)
    facts = json.loads(_vlod("info", tmp_path / "room.store", "--json").stdout)["cells"]
    assert [part["cells"] for part in facts["histogram"]] == [2, 1, 1, 1, 1, 0, 0, 2]
    assert [part["from"] for part in facts["histogram"]][:3] == [1.0, 1.1, 1.25]
    assert [part["to"] for part in facts["histogram"]][-2:] == [10.0, None]
    worst = facts["worst"]
    gaps = [row["reported_triangles"] - row["proven_triangles"] for row in worst]
    expected = (rows["triangles"].astype(np.int64) - rows["proven_triangles"].astype(np.int64)).tolist()
    assert gaps == sorted(expected, reverse=True)[: len(worst)]
    nothing = next(row for row in worst if row["cell"] == 1)
    assert nothing["tightness"] is None
    assert nothing["lo"] == store.cells["lo"][1].tolist()
    assert nothing["hi"] == store.cells["hi"][1].tolist()
    assert nothing["cut_triangles"] == int(store.cells["cut_triangles"][1]) > nothing["reported_triangles"]
    text = _vlod("info", tmp_path / "room.store").stdout
    lines = {line[2:].split("  ")[0]: line for line in text.splitlines() if line.startswith("  ")}
    cut, reported, proven = (int(rows[name].sum()) for name in ("cut_triangles", "triangles", "proven_triangles"))
    assert f"{cut - reported:,}" in lines["proven hidden"]
    assert f"{reported - proven:,}" in lines["undecided"]
    assert f"{proven:,}" in lines["proven visible"]
    assert lines["1 to 1.1"].count("#") == lines["10 or more"].count("#") == 24
    assert lines["1.1 to 1.25"].count("#") == 12
    low, high = (" ".join(f"{value:.4g}" for value in nothing[corner]) for corner in ("lo", "hi"))
    assert f"{low} to {high}" in text
    assert "approximation" not in text


def rewrite_cells(store: Store, rows: np.ndarray) -> None:
    """The same store with another table of cells."""
    root = Path(store.files.url)
    section = store.manifest.cells
    assert section is not None
    known = KnownCells(store.nodes, store.drawables, store.manifest.pixel_angle)
    shard = write_cell_shard(root, rows, [store.vlod(cell) for cell in range(len(rows))], known)
    octree = Octree(section.octree_lo, section.octree_size)
    commit(root, replace(store.manifest, cells=cells_section(root, octree, [shard])))


@pytest.mark.parametrize("kind", ["missing", "empty folder", "file", "unfinished", "damaged", "of another format"])
def test_what_is_no_sound_store_ends_in_one_line(tmp_path: Path, kind: str) -> None:
    place = tmp_path / "room.store"
    if kind == "empty folder":
        place.mkdir()
    elif kind == "file":
        place.write_bytes(b"glTF")
    elif kind != "missing":
        make_store(place, room_parts()[:1], depth=0)
        manifest = place / "manifest.json"
        if kind == "unfinished":
            manifest.unlink()
        elif kind == "damaged":
            manifest.write_bytes(manifest.read_bytes().replace(b'"version": 1', b'"version": 2'))
        else:
            manifest.write_bytes(b"{}")
    done = _vlod("info", place)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith(f"error: {place}")
    assert done.stderr.count("\n") == 1
    assert "Traceback" not in done.stderr
