"""The text over the picture."""

from __future__ import annotations

import moderngl

from player.renderer.targets.target import Target
from player.renderer.text import Atlas, TextOverlay, layout


def test_letters_lie_on_the_panel_and_unknown_ones_are_replaced() -> None:
    atlas = Atlas(14)
    vertices = layout(atlas, [("frames/s", "12"), ("☃", "")], (300, 200), "top left")
    panel = vertices[:6, :2]
    assert (vertices[:, :2] >= panel.min(axis=0)).all()
    assert (vertices[:, :2] <= panel.max(axis=0)).all()
    assert len(vertices) == 6 * (1 + len("frames/s12") + 1)


def test_text_is_drawn_where_it_belongs(context: moderngl.Context) -> None:
    target = Target(context, (200, 100), samples=0, reversed_depth=False)
    overlay = TextOverlay(context)
    target.framebuffer.use()
    target.framebuffer.clear()
    overlay.draw([("hello", "world")], target.framebuffer, target.size, "bottom right")
    picture = target.read()
    overlay.release()
    target.release()
    assert not picture[:40].any()
    assert not picture[:, :20].any()
    assert picture[50:, 100:, :3].max() > 200
