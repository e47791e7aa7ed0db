"""One page about one store: pictures, plots and numbers of building, checking and walking through it.

Everything is in the page itself; it opens anywhere, without a network.
"""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from jobs.report.plots import box_map, histogram, lines, share_legend, share_map
from storage import open_store
from storage.base.errors import ParameterError
from storage.cli.text import MAY_MISS

#: The film's width in pixels, and how long each of its frames stays, in milliseconds.
FILM_WIDTH, FILM_FRAME = 640, 60

#: Still pictures on the page, evenly spread over the path.
STILLS = 6

_STYLE = """
:root { color-scheme: light dark; --ink: #1d2730; --soft: #5c6a75; --rule: #d8dee3; --paper: #ffffff; --card: #f5f8f9; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e4eaee; --soft: #9fb0bb; --rule: #33414b; --paper: #141b20; --card: #1d272e; }
}
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 2.5rem 1.25rem 4rem; max-width: 1080px; color: var(--ink); background: var(--paper);
  font: 16px/1.55 system-ui, sans-serif; }
h1 { font-size: 2rem; line-height: 1.2; margin: 0 0 .4rem; }
h2 { font-size: 1.25rem; margin: 2.6rem 0 .8rem; }
p { max-width: 70ch; margin: .4rem 0; }
.soft, figcaption { color: var(--soft); }
img, svg { width: 100%; height: auto; display: block; border-radius: 6px; }
svg text { font: 12px system-ui, sans-serif; fill: var(--soft); }
svg .grid { stroke: var(--rule); }
.plot { background: var(--card); padding: .8rem; border-radius: 8px; }
.two { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(420px, 100%), 1fr)); gap: 1rem; }
.stills { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(300px, 100%), 1fr)); gap: .8rem; }
.facts { display: grid; grid-template-columns: repeat(auto-fit, minmax(150px, 1fr)); gap: .8rem; margin: 1.2rem 0; }
.facts div { background: var(--card); border-radius: 8px; padding: .7rem .9rem; }
.facts b { display: block; font-size: 1.35rem; font-variant-numeric: tabular-nums; }
figure { margin: 0; }
figcaption { font-size: .9rem; padding-top: .35rem; }
.legend span { margin-right: 1.2rem; white-space: nowrap; }
.legend i { display: inline-block; width: 1.4em; height: .25em; margin-right: .45em; vertical-align: middle; }
.legend.wide { max-width: none; }
.legend.wide span { margin-right: .9rem; }
.legend i.patch { width: 1.1em; height: 1.1em; border-radius: 3px; vertical-align: -.15em; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: .3rem .7rem; border-bottom: 1px solid var(--rule); white-space: nowrap; }
th:first-child, td:first-child { text-align: left; }
"""


def write_page(folder: Path) -> Path:
    """Writes `folder`/report.html and film.webp; returns the page's path.

    Reads build.json, verify.json, play.json and further play-*.json (reports of the commands) and the frames in
    frames/. Raises ParameterError where the reports are missing, and what `open_store` raises for the store that
    build.json names.
    """
    build, verify, play = (_read(folder / f"{name}.json") for name in ("build", "verify", "play"))
    others = [_read(path) for path in sorted(folder.glob("play-*.json"))]
    frames = [folder / "frames" / row["image"] for row in play["frames"] if row["image"]]
    film = folder / "film.webp"
    _write_film(frames, film)
    store = open_store(str(_find_store(build["store"], folder)))
    page = folder / "report.html"
    temporary = page.with_name(".report.html.part")
    temporary.write_text(_page(build, verify, [play, *others], store, frames, film), encoding="utf-8")
    temporary.replace(page)
    return page


def _page(
    build: dict[str, Any],
    verify: dict[str, Any],
    plays: Sequence[dict[str, Any]],
    store: Any,
    frames: Sequence[Path],
    film: Path,
) -> str:
    play = plays[0]
    model, counts = build["model"], build["counts"]
    computed = store.cells[store.cells["computed"]]
    drawn = play["totals"]["triangles"]["mean"]
    tightness = verify["tightness"]["triangles"]
    facts = _facts(
        [
            (f"{model['triangles']:,}", "triangles in the model"),
            (f"{drawn:,.0f}", "triangles drawn in a frame, mean"),
            (f"{counts['computed_cells']:,}", "view cells"),
            (f"{build['bytes']['total'] / 1e6:.1f} MB", "store on disk"),
            (f"{build['seconds']:.0f} s", f"to build, {build['workers']} workers"),
            (f"{verify['missed']}", f"drawables missed by {verify['rays']:,} rays"),
            ("-" if tightness is None else f"{tightness:.2f}", "triangles reported / seen"),
            (f"{play['totals']['frame_ms']['median']:.0f} ms", f"a frame, median ({play['graphics']['renderer']})"),
        ]
    )
    triangles = {report["strategy"]: [row["triangles"] for row in report["frames"]] for report in plays}
    times = {report["strategy"]: [row["frame_ms"] for row in report["frames"]] for report in plays}
    fetched = {report["strategy"]: [row["bytes_fetched"] / 1e6 for row in report["frames"]] for report in plays}
    sound = "sound" if verify["ok"] else "NOT sound"
    sections = [
        f"<h1>A walk through {model['triangles']:,} triangles</h1>",
        _paragraph(
            f"{Path(build['store']).name}: every frame draws what can be seen from its view cell, within "
            f"{play['pixel_error']:g} pixel of error."
        ),
        _figure(_data(film), f"{len(frames)} frames along the tour."),
        facts,
        "<h2>Along the path</h2>",
        '<div class="two">',
        _plot(lines(triangles, "frame", "triangles drawn", logarithmic=True), "Triangles drawn per strategy."),
        _plot(lines(times, "frame", "milliseconds", logarithmic=True), "Time per frame per strategy."),
        _plot(lines(fetched, "frame", "megabytes"), "Bytes fetched from the store since the start."),
        _plot(
            histogram(computed["triangles"].astype(np.float64), "triangles in a cell's visible set", "cells"),
            "Visible set per cell.",
        ),
        "</div>",
        "<h2>View cells</h2>",
        _plot(*_map(store, play)),
        "<h2>What the cells know of themselves</h2>",
        *_certificate(store, play),
        "<h2>Pictures</h2>",
        f'<div class="stills">{"".join(_stills(frames, play))}</div>',
        *_comparison(play, frames),
        "<h2>The build</h2>",
        _stages(build),
        "<h2>The check</h2>",
        _paragraph(
            f"{verify['sampled_cells']} of {verify['cells']:,} cells, {verify['rays']:,} rays from their surfaces, "
            f"{verify['read_cells']:,} read again: {sound}, {verify['missed']} drawables missed."
        ),
        _table(
            ["reported / seen", "triangles", "drawables"],
            [["all sampled cells", *(_ratio(verify["tightness"][unit]) for unit in ("triangles", "drawables"))]],
        ),
        "<h2>The walk</h2>",
        _walks(plays),
    ]
    return (
        '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1"><title>vLOD: a walk</title>'
        f"<style>{_STYLE}</style></head><body>\n" + "\n".join(sections) + "\n</body></html>\n"
    )


def _read(path: Path) -> dict[str, Any]:
    try:
        content: dict[str, Any] = json.loads(path.read_text())
    except FileNotFoundError:
        raise ParameterError(f"{path} is missing: build, verify and play first, as deploy/demo.sh does") from None
    except ValueError:
        raise ParameterError(f"{path} is not a report (JSON): make it again") from None
    return content


def _find_store(named: str, folder: Path) -> Path:
    """The store that a build report names, which may have moved together with the report."""
    return Path(named) if Path(named).exists() else folder / Path(named).name


def _write_film(frames: Sequence[Path], film: Path) -> None:
    """The frames as an animated WebP."""
    from PIL import Image

    pictures = []
    for path in frames:
        with Image.open(path) as picture:
            height = round(picture.height * FILM_WIDTH / picture.width)
            pictures.append(picture.convert("RGB").resize((FILM_WIDTH, height), Image.Resampling.LANCZOS))
    if not pictures:
        raise ParameterError(f"{film.parent / 'frames'} holds no frames: play with --frames {film.parent / 'frames'}")
    pictures[0].save(film, save_all=True, append_images=pictures[1:], duration=FILM_FRAME, loop=0, quality=60, method=2)


def _data(path: Path, width: int | None = None) -> str:
    """A picture as a data address; scaled down to `width` pixels, as JPEG, if that is given."""
    if width is None:
        kind, content = f"image/{path.suffix[1:]}", path.read_bytes()
    else:
        from PIL import Image

        with Image.open(path) as picture:
            smaller = picture.convert("RGB")
            smaller.thumbnail((width, width))
            buffer = io.BytesIO()
            smaller.save(buffer, "JPEG", quality=82)
        kind, content = "image/jpeg", buffer.getvalue()
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def _facts(entries: Iterable[tuple[str, str]]) -> str:
    cards = (f"<div><b>{escape(value)}</b>{escape(what)}</div>" for value, what in entries)
    return f'<div class="facts">{"".join(cards)}</div>'


def _paragraph(text: str) -> str:
    return f"<p>{escape(text)}</p>"


def _figure(picture: str, caption: str) -> str:
    said = escape(caption)
    return f'<figure><img src="{picture}" alt="{said}"><figcaption>{said}</figcaption></figure>'


def _plot(svg: str, caption: str) -> str:
    return f'<figure class="plot">{svg}<figcaption>{escape(caption)}</figcaption></figure>'


def _map(store: Any, play: dict[str, Any]) -> tuple[str, str]:
    """The cells that the path passes at its middle height, seen from above, and a caption."""
    up = "xyz".index(store.manifest.model.up)
    across = [axis for axis in range(3) if axis != up]
    path = np.array([row["position"] for row in play["frames"]], np.float64)
    height = float(np.median(path[:, up]))
    cells = store.cells
    layer = cells[cells["computed"] & (cells["lo"][:, up] <= height) & (cells["hi"][:, up] > height)]
    # From above, the second axis points up the page where up is z, and down it where up is y.
    picture = box_map(
        layer["lo"][:, across],
        layer["hi"][:, across],
        layer["triangles"].astype(np.float64),
        path[:, across],
        "cells",
        flip_y=up == 2,
    )
    least, most = int(layer["triangles"].min(initial=2**62)), int(layer["triangles"].max(initial=0))
    return picture, (
        f"The {len(layer):,} cells at the height of the path, from above: the darker, the more triangles can be seen, "
        f"from {min(least, most):,} to {most:,}. The line is the path."
    )


def _certificate(store: Any, play: dict[str, Any]) -> Iterable[str]:
    """How much of what is reported is proven visible: in words, and as maps from above."""
    cells = store.cells[store.cells["computed"]]
    counted = ("triangles", "proven_triangles", "cut_triangles")
    reported, proven, cut = (cells[name].astype(np.int64) for name in counted)
    whole = max(int(cut.sum()), 1)
    parts = [100 * int(part.sum()) / whole for part in (proven, reported - proven, cut - reported)]
    approximation = store.manifest.approximation
    hidden = "left out" if approximation else "proven hidden"
    yield _paragraph(
        f"Of the triangles that stand for the model in its cells {parts[0]:.2f} % are proven visible, {parts[2]:.2f} % "
        f"{hidden} and {parts[1]:.2f} % undecided: these are drawn, perhaps in vain."
    )
    if approximation:
        rays, missed = (int(cells[name].sum(dtype=np.int64)) for name in ("hold_out_rays", "missed_rays"))
        caution = MAY_MISS.format(approximation)
        yield _paragraph(f"The store was {caution}: {missed:,} of {rays:,} rays met what is left out.")
    up = "xyz".index(store.manifest.model.up)
    across = [axis for axis in range(3) if axis != up]
    height = float(np.median([row["position"][up] for row in play["frames"]]))
    shares = (reported - proven) / np.maximum(reported, 1)
    level = (cells["lo"][:, up] <= height) & (cells["hi"][:, up] > height)
    chosen = {
        "Cells at the height of the path, from above": np.flatnonzero(level),
        "All cells from above, the worst of those one above the other": _worst_of_columns(cells, across, shares),
    }
    yield '<div class="two">'
    for title, rows in chosen.items():
        said = [
            f"{100 * shares[at]:.0f} % undecided: {reported[at] - proven[at]:,} of {reported[at]:,} triangles"
            for at in rows.tolist()
        ]
        lo, hi = cells["lo"][rows][:, across], cells["hi"][rows][:, across]
        yield _plot(share_map(lo, hi, shares[rows], said, title, flip_y=up == 2), f"{title}.")
    yield "</div>"
    yield '<p class="soft">Undecided part of the triangles that a cell reports:</p>'
    yield share_legend()


def _worst_of_columns(cells: np.ndarray, across: list[int], shares: np.ndarray) -> np.ndarray:
    """Of cells that look the same from above, the one with the greatest share; rows of `cells`."""
    order = np.argsort(-shares, kind="stable")
    seen = np.concatenate([cells["lo"][:, across], cells["hi"][:, across]], axis=1)[order]
    _, first = np.unique(seen, axis=0, return_index=True)
    return order[np.sort(first)]


def _stills(frames: Sequence[Path], play: dict[str, Any]) -> Iterable[str]:
    rows = [row for row in play["frames"] if row["image"]]
    for at in np.unique(np.linspace(0, len(frames) - 1, min(STILLS, len(frames))).astype(int)).tolist():
        row = rows[at]
        caption = f"Frame {row['index']}: {row['triangles']:,} triangles, {row['drawables']:,} drawables."
        yield _figure(_data(frames[at], 640), caption)


def _comparison(play: dict[str, Any], frames: Sequence[Path]) -> Iterable[str]:
    compared = play.get("compare")
    if not compared or not compared["images"]:
        return
    captions = {"drawn": "drawn", "full": "the full model", "difference": "their difference, magnified"}
    yield f"<h2>The worst frame against the full model: frame {compared['worst_frame']}</h2>"
    folder = frames[0].parent
    figures = (_figure(_data(folder / compared["images"][what], 640), said) for what, said in captions.items())
    yield f'<div class="stills">{"".join(figures)}</div>'
    yield _paragraph(
        f"{compared['holes']:,} holes, {compared['holes_in_a_million']:.2f} in a million covered pixels; at most "
        f"{100 * compared['largest_differing']:.2f} % of a frame's pixels differ by more than 16 grey levels."
    )


def _stages(build: dict[str, Any]) -> str:
    head = ["stage", "tasks run", "reused", "seconds", "core seconds", "peak memory", "largest task", "shards"]
    rows = [
        [
            stage["name"],
            f"{stage['run']:,}",
            f"{stage['reused']:,}",
            f"{stage['seconds']:.1f}",
            f"{stage['core_seconds']:.1f}",
            f"{stage['peak_memory'] / 2**20:,.0f} MiB",
            f"{stage['peak_task_memory'] / 2**20:,.0f} MiB",
            f"{stage['shard_bytes'] / 1e6:.1f} MB",
        ]
        for stage in build["stages"]
    ]
    return _table(head, rows)


def _walks(plays: Sequence[dict[str, Any]]) -> str:
    head = ["strategy", "triangles, mean", "max", "frame, median", "95 %", "fetched", "on the GPU, max"]
    rows = []
    for play in plays:
        totals = play["totals"]
        rows.append(
            [
                play["strategy"],
                f"{totals['triangles']['mean']:,.0f}",
                f"{totals['triangles']['max']:,.0f}",
                f"{totals['frame_ms']['median']:.1f} ms",
                f"{totals['frame_ms']['p95']:.1f} ms",
                f"{totals['bytes_fetched'] / 1e6:.1f} MB",
                f"{totals['cache_bytes']['max'] / 1e6:.1f} MB",
            ]
        )
    return _table(head, rows)


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f'<div class="scroll"><table><tr>{top}</tr>{body}</table></div>'


def _ratio(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
