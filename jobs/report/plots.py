"""Plots as SVG text, for pages that must open anywhere: lines, a histogram, a map of boxes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

WIDTH, HEIGHT = 720, 300
_LEFT, _RIGHT, _TOP, _BOTTOM = 64, 14, 14, 40

#: Colours of a plot's series, in order.
COLOURS = ("#0f8b8d", "#e07a1f", "#7a6fb0", "#c2415d")

#: Steps of a map of shares: each colour stands for shares up to this one.
SHARES = (0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 1.0)
SHARE_COLOURS = ("#23777e", "#5fa8a0", "#a9d0b4", "#eae7b9", "#f4c676", "#e8914a", "#cf5636", "#8f1d2c")


def lines(series: Mapping[str, Sequence[float]], x_label: str, y_label: str, *, logarithmic: bool = False) -> str:
    """Lines over 0, 1, 2, ..., one for each named series, with a legend."""
    top = max((max(values, default=0.0) for values in series.values()), default=0.0) or 1.0
    low = min((min((v for v in values if v > 0), default=top) for values in series.values()), default=top)
    scale = _Scale.over(low if logarithmic else 0.0, top, logarithmic)
    count = max((len(values) for values in series.values()), default=1)
    parts = _frame(scale, _steps(count - 1), max(count - 1, 1), x_label, y_label)
    for values, colour in zip(series.values(), COLOURS, strict=False):
        points = " ".join(
            f"{_x(at / max(count - 1, 1)):.1f},{_y(scale.place(value)):.1f}" for at, value in enumerate(values)
        )
        parts.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="2"/>')
    return _svg(parts, y_label) + _legend(list(series))


def histogram(values: np.ndarray, x_label: str, y_label: str, bins: int = 40) -> str:
    """How often values (n,) occur."""
    top = float(values.max(initial=0.0)) or 1.0
    counts, _ = np.histogram(values, bins=bins, range=(0.0, top))
    scale = _Scale.over(0.0, float(counts.max(initial=1)), False)
    parts = _frame(scale, _steps(top), top, x_label, y_label)
    for number, count in enumerate(counts.tolist()):
        left, right = _x(number / bins), _x((number + 1) / bins)
        y = _y(scale.place(count))
        parts.append(
            f'<rect x="{left + 0.5:.1f}" y="{y:.1f}" width="{right - left - 1:.1f}" '
            f'height="{_y(0) - y:.1f}" fill="{COLOURS[0]}"/>'
        )
    return _svg(parts, x_label)


def box_map(
    lo: np.ndarray, hi: np.ndarray, values: np.ndarray, path: np.ndarray, title: str, flip_y: bool = True
) -> str:
    """Rectangles lo to hi (n, 2) coloured by values (n,), pale to dark, under a path (m, 2)."""
    least = float(values.min(initial=np.inf))
    spread = max(float(values.max(initial=0.0)) - least, 1e-9)
    fills = [_shade((value - least) / spread) for value in values.tolist()]
    return _rectangles(lo, hi, fills, [f"{value:,.0f}" for value in values.tolist()], path, title, flip_y)


def share_map(
    lo: np.ndarray, hi: np.ndarray, shares: np.ndarray, said: Sequence[str], title: str, flip_y: bool = True
) -> str:
    """Rectangles lo to hi (n, 2) coloured by shares (n,) from 0 to 1 in few steps, the greatest on top.

    said: what each rectangle says under the pointer. `share_legend` explains the colours.
    """
    order = np.argsort(shares, kind="stable")
    steps = np.searchsorted(SHARES, shares[order], side="left").tolist()
    texts = [said[at] for at in order.tolist()]
    none = np.zeros((0, 2))
    return _rectangles(lo[order], hi[order], [SHARE_COLOURS[step] for step in steps], texts, none, title, flip_y)


def share_legend() -> str:
    """What the colours of `share_map` mean."""
    names = [f"{100 * low:g} to {100 * high:g} %" for low, high in zip((0.0, *SHARES), SHARES, strict=False)]
    items = (
        f'<span><i class="patch" style="background:{colour}"></i>{name}</span>'
        for name, colour in zip(names, SHARE_COLOURS, strict=True)
    )
    return f'<p class="legend wide">{"".join(items)}</p>'


def _rectangles(
    lo: np.ndarray,
    hi: np.ndarray,
    fills: Sequence[str],
    said: Sequence[str],
    path: np.ndarray,
    title: str,
    flip_y: bool,
) -> str:
    """Rectangles lo to hi (n, 2), each with its colour and what it says under the pointer, and a path (m, 2) above."""
    corners = np.concatenate([lo, hi, path])
    low, high = (corners.min(axis=0), corners.max(axis=0)) if len(corners) else (np.zeros(2), np.ones(2))
    size = np.maximum(high - low, 1e-9)
    width = WIDTH - 20
    height = min(width * size[1] / size[0], 560.0)
    width = height * size[0] / size[1]

    def spot(points: np.ndarray) -> np.ndarray:
        unit = (points - low) / size
        if flip_y:
            unit[:, 1] = 1 - unit[:, 1]
        return 10 + unit * [width, height]

    a, b = spot(lo), spot(hi)
    left, right = np.minimum(a, b), np.maximum(a, b)
    parts = [
        f'<rect x="{corner[0]:.1f}" y="{corner[1]:.1f}" width="{far[0] - corner[0]:.1f}" '
        f'height="{far[1] - corner[1]:.1f}" fill="{fill}" stroke="#ffffff" stroke-width="0.4">'
        f"<title>{escape(text)}</title></rect>"
        for corner, far, fill, text in zip(left.tolist(), right.tolist(), fills, said, strict=True)
    ]
    if len(path):
        track = " ".join(f"{x:.1f},{y:.1f}" for x, y in spot(path).tolist())
        parts.append(f'<polyline points="{track}" fill="none" stroke="{COLOURS[1]}" stroke-width="2.5"/>')
    body = "".join(parts)
    return f'<svg viewBox="0 0 {width + 20:.0f} {height + 20:.0f}" role="img" aria-label="{escape(title)}">{body}</svg>'


class _Scale:
    """Values on the upright axis."""

    def __init__(self, low: float, high: float, marks: list[float], logarithmic: bool) -> None:
        self.low, self.high, self.marks, self.logarithmic = low, high, marks, logarithmic

    @staticmethod
    def over(low: float, high: float, logarithmic: bool) -> _Scale:
        if not logarithmic:
            marks = _steps(high)
            return _Scale(0.0, max(high, marks[-1]), marks, False)
        first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
        last = max(last, first + 1)
        return _Scale(10.0**first, 10.0**last, [10.0**power for power in range(first, last + 1)], True)

    def place(self, value: float) -> float:
        if self.logarithmic:
            value = max(value, self.low)
            return math.log(value / self.low) / math.log(self.high / self.low)
        return value / self.high


def _steps(top: float) -> list[float]:
    """Four to eight round marks from 0 up to `top`."""
    raw = max(top, 1e-9) / 5
    unit = 10.0 ** math.floor(math.log10(raw))
    step = next(unit * factor for factor in (1, 2, 5, 10) if unit * factor >= raw)
    return [step * number for number in range(int(top / step + 1e-9) + 1)]


def _x(part: float) -> float:
    return _LEFT + part * (WIDTH - _LEFT - _RIGHT)


def _y(part: float) -> float:
    return HEIGHT - _BOTTOM - part * (HEIGHT - _TOP - _BOTTOM)


def _short(value: float) -> str:
    for size, unit in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= size:
            return f"{value / size:g}{unit}"
    return f"{value:g}"


def _frame(scale: _Scale, x_marks: Sequence[float], x_top: float, x_label: str, y_label: str) -> list[str]:
    parts = []
    for mark in scale.marks:
        y = _y(scale.place(mark))
        parts.append(f'<line class="grid" x1="{_LEFT}" x2="{WIDTH - _RIGHT}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(f'<text x="{_LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{_short(mark)}</text>')
    parts.extend(
        f'<text x="{_x(mark / x_top):.1f}" y="{HEIGHT - 22}" text-anchor="middle">{_short(mark)}</text>'
        for mark in x_marks
    )
    parts.append(f'<text x="{_x(0.5):.0f}" y="{HEIGHT - 5}" text-anchor="middle">{escape(x_label)}</text>')
    turned = f'x="14" y="{_y(0.5):.0f}" text-anchor="middle" transform="rotate(-90 14 {_y(0.5):.0f})"'
    parts.append(f"<text {turned}>{escape(y_label)}</text>")
    return parts


def _svg(parts: Sequence[str], label: str) -> str:
    return f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(label)}">{"".join(parts)}</svg>'


def _legend(names: Sequence[str]) -> str:
    items = (
        f'<span><i style="background:{colour}"></i>{escape(name)}</span>'
        for name, colour in zip(names, COLOURS, strict=False)
    )
    return f'<p class="legend">{"".join(items)}</p>'


def _shade(part: float) -> str:
    """From pale to dark teal."""
    pale, dark = (226, 241, 240), (8, 64, 74)
    part = min(max(part, 0.0), 1.0)
    return "#" + "".join(f"{round(p + (d - p) * part):02x}" for p, d in zip(pale, dark, strict=True))
