"""What a store holds, as text for people: on a terminal as tables, elsewhere as aligned lines."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

import click

#: Characters of the histogram's longest bar.
BAR = 24
#: How many of the cells with the largest raised pixel errors are named; --json names all.
LARGEST = 20

#: What the certificate counts.
_UNITS = ("drawables", "triangles")

#: How a store says that it may miss something.
MAY_MISS = "made with {}: cells may miss what can be seen"


class Section(NamedTuple):
    """A part of the report: a title, column heads (none: names and values), rows of text."""

    title: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]


def sections(facts: dict[str, Any]) -> list[Section]:
    """The facts of `storage.cli.facts.collect`, as text for people."""
    model, counts, cells = facts["model"], facts["counts"], facts["cells"]
    extent = [high - low for low, high in zip(model["lo"], model["hi"], strict=True)]
    found = [
        Section(
            f"{facts['store']}  (version {facts['version']}, format {facts['format']})",
            (),
            [
                ("model", f"{model['triangles']:,} triangles in {counts['parts']:,} parts"),
                ("extent", " x ".join(f"{value:g}" for value in extent) + f", up is {model['up']}"),
                ("unit", f"{model['unit_in_metres']:g} m"),
                ("digest", str(model["digest"])),
                ("instances", f"{counts['instances']:,}"),
                ("nodes", f"{counts['nodes']:,}, {counts['leaves']:,} of them leaves"),
                ("see-through", "{drawables:,} drawables of {triangles:,} triangles".format(**facts["see_through"])),
                *([("approximation", MAY_MISS.format(how))] if (how := facts["approximation"]) else []),
                ("pixel angle", f"{facts['pixel_angle']:.3g} model units per unit of distance"),
            ],
        ),
        Section(
            "Drawables",
            ("level of", "drawables", "triangles", "median error", "allowed from", "largest error", "allowed from"),
            [
                (
                    f"{row['of']}, {row['level']}",
                    f"{row['drawables']:,}",
                    f"{row['triangles']:,}",
                    *(
                        length(row[f"{which}_{what}"] * model["unit_in_metres"])
                        for which in ("median", "largest")
                        for what in ("error", "allowed_from")
                    ),
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
        if name not in ("total", "shards", "per_cell", "per_stored_triangle")
    ]
    total = (f"total, in {sizes['shards']:,} shards", _size(sizes["total"]), "100 %")
    each = [("meshes, a stored triangle", _each(sizes["per_stored_triangle"]), "")]
    if sizes["per_cell"] is not None:
        each.append(("what is seen from a cell", _each(sizes["per_cell"]), ""))
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
    return [Section(f"Cells with a raised pixel error, to keep a bound{told}", heads, rows)]


def plain(section: Section) -> str:
    """A section as lines of aligned text."""
    rows = [*([section.heads] if section.heads else []), *section.rows]
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = [section.title]
    for row in rows:
        numbers = zip(row[1:], widths[1:], strict=True)
        cells = [text.rjust(width) if section.heads else text for text, width in numbers]
        lines.append("  ".join(["", row[0].ljust(widths[0]), *cells]).rstrip())
    return "\n".join(lines)


def show(found: Sequence[Section]) -> None:
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


def say(facts: dict[str, Any], found: Sequence[Section], *, as_json: bool) -> None:
    """Prints facts: as JSON, or their sections as fits where they go."""
    if as_json:
        click.echo(json.dumps(facts, indent=1))
    elif sys.stdout.isatty():
        show(found)
    else:
        click.echo("\n\n".join(plain(section) for section in found))


def length(metres: float) -> str:
    """A length for people, in the unit that suits it, to three digits."""
    for unit, size in (("km", 1e3), ("m", 1.0), ("mm", 1e-3)):
        if float(f"{metres / size:.3g}") >= 1:
            return f"{float(f'{metres / size:.3g}'):,g} {unit}"
    return f"{metres / 1e-6:.3g} µm"


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
