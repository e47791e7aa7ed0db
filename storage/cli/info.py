"""`vlod info`: what a store holds, for people and as JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

import click
import numpy as np

from storage.shards.manifest import FILE
from storage.shards.shards import Kind
from storage.store import Store, open_store

#: How many of the cells with the largest gaps are named.
WORST = 5

#: Where the bins of the histogram of cells by tightness begin; cells of which nothing is proven are in the last one.
BINS = (1.0, 1.1, 1.25, 1.5, 2.0, 3.0, 5.0, 10.0)
#: Characters of the histogram's longest bar.
BAR = 24
#: How many of the cells with the largest raised pixel errors are named; --json names all.
LARGEST = 20

#: What the kinds of frames are called.
_KINDS = {
    Kind.GEOMETRY: "meshes",
    Kind.SOURCE_FACES: "source faces",
    Kind.TABLE: "tables",
    Kind.NAMES: "names",
    Kind.KEY_SET: "key sets of cells",
    Kind.DELTAS: "changes across boundaries",
}


#: What the certificate counts.
_UNITS = ("drawables", "triangles")

#: How a store says that it may miss something.
MAY_MISS = "made with {}: cells may miss what can be seen"


class Section(NamedTuple):
    """A part of the report: a title, column heads (none: names and values), rows of text."""

    title: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]


@click.command(epilog="Example: vlod info ship.store", no_args_is_help=True)
@click.argument("store")
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
def info(store: str, as_json: bool) -> None:
    """Say what STORE (a folder or a URL) holds: its model, drawables, cells, and where its bytes are."""
    facts = collect(open_store(store))
    if as_json:
        click.echo(json.dumps(facts, indent=1))
    elif sys.stdout.isatty():
        _show(sections(facts))
    else:
        click.echo("\n\n".join(_plain(section) for section in sections(facts)))


def collect(store: Store) -> dict[str, Any]:
    """All facts about a store, as JSON holds them. Lengths in model units, sizes in bytes, errors in model units."""
    manifest = store.manifest
    return {
        "store": store.files.url,
        "format": manifest.format,
        "version": manifest.version,
        "model": dict(manifest.model),
        "parameters": dict(manifest.parameters),
        "approximation": manifest.approximation,
        "pixel_angle": manifest.pixel_angle,
        "counts": manifest.counts,
        "levels": _levels(store),
        "cells": _cells(store),
        "bytes": _bytes(store),
    }


def _levels(store: Store) -> list[dict[str, Any]]:
    rows = store.drawables
    found = []
    for level in np.unique(rows["level"]).tolist():
        own = rows[rows["level"] == level]
        found.append(
            {
                "level": level,
                "drawables": len(own),
                "triangles": int(own["triangles"].sum(dtype=np.int64)),
                "median_error": float(np.median(own["error"])),
                "largest_error": float(own["error"].max()),
            }
        )
    return found


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
    """Those of some cells whose pixel error was raised to keep --max-triangles, the largest error first."""
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
    shards = sum(record.bytes for _, record in store.manifest.shards())
    manifest = store.files.size(FILE) or 0
    boundaries = store.boundary_count
    triangles = store.manifest.counts["stored_triangles"]
    return {
        "manifest": manifest,
        **named,
        "indices and checksums": shards - sum(named.values()),
        "total": shards + manifest,
        "shards": sum(1 for _ in store.manifest.shards()),
        "boundaries": boundaries,
        "per_boundary": _ratio(kinds.get(Kind.DELTAS, 0), boundaries),
        "per_stored_triangle": _ratio(kinds.get(Kind.GEOMETRY, 0), triangles),
    }


def sections(facts: dict[str, Any]) -> list[Section]:
    """The facts that `collect` gave, as text for people."""
    model, counts, cells = facts["model"], facts["counts"], facts["cells"]
    extent = [high - low for low, high in zip(model["lo"], model["hi"], strict=True)]
    found = [
        Section(
            f"{facts['store']}  (version {facts['version']}, format {facts['format']})",
            (),
            [
                ("model", f"{model['triangles']:,} triangles in {counts['parts']:,} parts"),
                ("extent", " x ".join(f"{value:g}" for value in extent) + f", up is {model['up']}"),
                ("unit", f"{model['unit_in_metres']:g} m" if model["unit_in_metres"] else "not known"),
                ("digest", str(model["digest"])),
                ("instances", f"{counts['instances']:,}"),
                ("nodes", f"{counts['nodes']:,}, {counts['leaves']:,} of them leaves"),
                *([("approximation", MAY_MISS.format(how))] if (how := facts["approximation"]) else []),
                ("pixel angle", f"{facts['pixel_angle']:.3g} model units per unit of distance"),
            ],
        ),
        Section(
            "Drawables",
            ("level", "drawables", "triangles", "median error", "largest error"),
            [
                (
                    str(row["level"]),
                    f"{row['drawables']:,}",
                    f"{row['triangles']:,}",
                    f"{row['median_error']:.3g}",
                    f"{row['largest_error']:.3g}",
                )
                for row in facts["levels"]
            ],
        ),
    ]
    if cells["computed"]:
        found += _cell_sections(cells, facts["approximation"] is not None)
    else:
        found.append(Section("Cells", (), [("computed", f"0 of {cells['cells']:,}")]))
    sizes = facts["bytes"]
    kinds = [
        (name, _size(size), f"{100 * size / sizes['total']:.1f} %")
        for name, size in sizes.items()
        if name not in ("total", "shards", "boundaries", "per_boundary", "per_stored_triangle")
    ]
    total = (f"total, in {sizes['shards']:,} shards", _size(sizes["total"]), "100 %")
    each = [("meshes, a stored triangle", _each(sizes["per_stored_triangle"]), "")]
    if sizes["boundaries"]:
        each.append((f"changes, each of {sizes['boundaries']:,} boundaries", _each(sizes["per_boundary"]), ""))
    found.append(Section("Bytes", ("what", "size", "share"), [*kinds, total, *each]))
    return found


def _cell_sections(cells: dict[str, Any], approximate: bool) -> list[Section]:
    depths = [f"{count:,} at depth {depth}" for depth, count in cells["depths"].items()]
    above = cells["above_target"]
    rows = [
        ("computed", f"{cells['computed']:,} of {cells['cells']:,}"),
        ("depths", ", ".join(depths)),
        ("edges", f"{cells['smallest_edge']:.3g} to {cells['largest_edge']:.3g}"),
        *([] if above is None else [("above --triangles-per-cell", f"{above:,}")]),
        ("pixel error raised", f"{len(cells['raised']):,}"),
        ("drawables in a vLOD", f"{cells['median_drawables']:,.0f} (median)"),
        (
            "triangles in a vLOD",
            f"{cells['median_triangles']:,.0f} (median), {cells['largest_triangles']:,} (largest)",
        ),
        (
            "turned away, not drawn",
            f"{100 * cells['turned_share']:.1f} % of a vLOD's triangles (mean), {cells['turned_triangles']:,} in all",
        ),
        ("tightness at most", f"{_times(cells['tightness'])} (triangles reported / proven visible)"),
    ]
    if approximate:
        rays, missed = cells["hold_out_rays"], cells["missed_rays"]
        rows.append(("missed pixels", f"{missed / max(1, rays):.2g} ({missed:,} of {rays:,} rays)"))
    counts = {unit: [cells[f"{kind}_{unit}"] for kind in ("proven", "reported", "cut")] for unit in _UNITS}
    hidden = "left out" if approximate else "proven hidden"
    certificate = [
        (
            name,
            *(
                text
                for unit in _UNITS
                for text in (f"{part[unit]:,}", f"{100 * part[unit] / max(1, counts[unit][2]):.2f} %")
            ),
        )
        for name, part in (
            ("proven visible", {unit: proven for unit, (proven, _, _) in counts.items()}),
            ("undecided", {unit: reported - proven for unit, (proven, reported, _) in counts.items()}),
            (hidden, {unit: cut - reported for unit, (_, reported, cut) in counts.items()}),
        )
    ]
    most = max(part["cells"] for part in cells["histogram"])
    histogram = [
        (
            f"{part['from']:g} to {part['to']:g}" if part["to"] else f"{part['from']:g} or more",
            f"{part['cells']:,}",
            f"{100 * part['cells'] / cells['computed']:.1f} %",
            ("#" * -(-BAR * part["cells"] // most)).ljust(BAR),
        )
        for part in cells["histogram"]
    ]
    worst = [
        (
            str(row["cell"]),
            f"{row['reported_triangles']:,}",
            f"{row['proven_triangles']:,}",
            f"{row['cut_triangles']:,}",
            _times(row["tightness"]),
            " to ".join(" ".join(f"{value:.4g}" for value in row[corner]) for corner in ("lo", "hi")),
        )
        for row in cells["worst"]
    ]
    heads = ("cell", "reported", "proven", "cut", "tightness", "box")
    return [
        Section("Cells", (), rows),
        Section(
            "Certificate, all cells together",
            ("of the cuts", "drawables", "share", "triangles", "share"),
            certificate,
        ),
        Section("Cells by tightness", ("reported / proven", "cells", "share", "".ljust(BAR)), histogram),
        *([Section("Cells with the largest gaps", heads, worst)] if worst else []),
        *_raised_sections(cells["raised"]),
    ]


def _raised_sections(raised: Sequence[dict[str, Any]]) -> list[Section]:
    """The cells whose pixel error was raised, the largest first; --json has all of them."""
    if not raised:
        return []
    told = f", {LARGEST} of {len(raised):,}" if len(raised) > LARGEST else ""
    rows = [
        (
            str(row["cell"]),
            f"{row['pixel_error']:g}",
            f"{row['reported_triangles']:,}",
            *(", ".join(f"{value:.4g}" for value in row[corner]) for corner in ("lo", "hi")),
        )
        for row in raised[:LARGEST]
    ]
    heads = ("cell", "pixel error", "reported", "from", "to")
    return [Section(f"Cells with a raised pixel error, to keep --max-triangles{told}", heads, rows)]


def _plain(section: Section) -> str:
    """A section as lines of aligned text."""
    rows = [*([section.heads] if section.heads else []), *section.rows]
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = [section.title]
    for row in rows:
        numbers = zip(row[1:], widths[1:], strict=True)
        cells = [text.rjust(width) if section.heads else text for text, width in numbers]
        lines.append("  ".join(["", row[0].ljust(widths[0]), *cells]).rstrip())
    return "\n".join(lines)


def _show(found: Sequence[Section]) -> None:
    """Prints sections as tables on a terminal."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    console = Console(highlight=False)
    for section in found:
        table = Table(
            title=section.title,
            title_justify="left",
            title_style="bold cyan",
            box=box.SIMPLE_HEAD if section.heads else box.SIMPLE,
            show_header=bool(section.heads),
            header_style="bold",
            pad_edge=False,
        )
        for column in range(len(section.rows[0]) if section.rows else len(section.heads)):
            numeric = column > 0 and bool(section.heads)
            table.add_column(
                section.heads[column] if section.heads else "",
                justify="right" if numeric else "left",
                style="dim" if column == 0 and not section.heads else None,
                no_wrap=column == 0,
            )
        for row in section.rows:
            table.add_row(*row)
        console.print(table)


def _ratio(above: float, below: float) -> float | None:
    return float(above) / float(below) if below else None


def _times(ratio: float | None) -> str:
    return "-" if ratio is None else f"{ratio:.2f}"


def _each(size: float | None) -> str:
    return "-" if size is None else f"{size:.2f} B"


def _size(size: float) -> str:
    """A number of bytes for people: 1 KB is 1000 bytes."""
    for unit in ("B", "KB", "MB", "GB"):
        if size < 1000 or unit == "GB":
            break
        size /= 1000
    return f"{size:.0f} {unit}" if unit == "B" else f"{size:.1f} {unit}"
