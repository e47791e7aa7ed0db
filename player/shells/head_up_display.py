"""What the window writes over its picture: the frame's statistics, and a message."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

from player.walkthrough import FrameStatistics

#: Letters in a line of a message.
_LINE = 100


@dataclass(frozen=True)
class Situation:
    """What is said beside a frame's own statistics."""

    milliseconds: float  # from one frame to the next, on average
    pixel_error: float  # allowed, in pixels
    frozen: bool  # culling does not follow the view
    pending: int  # packs to come
    moving: str  # how one moves, such as "walking"
    speed: float  # model units a second
    model_triangles: int


def statistics_rows(s: FrameStatistics, now: Situation) -> list[tuple[str, str]]:
    """What is measured and what it is: two columns."""
    cell = "none" if s.cell < 0 else str(s.cell)
    source = f", its vLOD{' (approximate)' if s.approximate else ''}" if s.computed else ""
    part = 100 * s.triangles / max(now.model_triangles, 1)
    return [
        ("frames/s", f"{1000 / max(now.milliseconds, 1e-3):.0f}  ({s.frame_ms:.1f} ms, {s.cpu_ms:.1f} ms CPU)"),
        ("strategy", f"{s.strategy}{' (frozen)' if now.frozen else ''}, cell {cell}{source}"),
        ("allowed error", f"{now.pixel_error:.2f} pixels"),
        ("triangles", f"{s.triangles:,} of {now.model_triangles:,} ({part:.1f} %)"),
        ("turned away", f"{s.turned_triangles:,} triangles left out"),
        ("drawables", f"{s.drawables:,} in {s.draw_calls} draw calls"),
        ("on the GPU", f"{s.cache_bytes / 1e6:.1f} MB, {now.pending} packs to come"),
        ("fetched", f"{s.bytes_fetched / 1e6:.1f} MB"),
        ("stand-ins", f"{s.replaced:,} other levels, {s.absent:,} not there yet"),
        ("moving", f"{now.moving} at {now.speed:.3g} units/s"),
    ]


def message_rows(s: FrameStatistics, pending: int, otherwise: str) -> list[tuple[str]]:
    """Lines at the bottom: what cannot be had comes before what is only to come, and that before anything else."""
    if s.unreadable:
        said = f"what cannot be had for now: {s.unreadable} packs or lists; others stand in: {s.trouble}"
    elif s.trouble:
        said = s.trouble
    elif s.absent:
        said = f"{pending} packs to come ..."
    else:
        said = otherwise
    return [(line,) for line in textwrap.wrap(said, _LINE)]
