"""Pictures that must not change by accident.

They are rendered everywhere and compared only where Mesa's llvmpipe draws, with some tolerance, because its versions
round differently. To make them anew after an intended change, look at them, and commit them:

    VLOD_REGENERATE_GOLDEN=1 pytest tests/golden
"""

from __future__ import annotations

import os
from pathlib import Path

import moderngl
import numpy as np
import pytest
from PIL import Image

from player.camera.view import View
from player.renderer.context import abilities
from player.renderer.target import Target
from player.renderer.text import TextOverlay
from player.shown_model import ShownModel, shown_model
from player.walkthrough import Settings, Walkthrough
from tests.player.conftest import context, room, view_from  # noqa: F401

IMAGES = Path(__file__).with_name("images")

SIZE = (160, 120)

#: Part of the pixels that may be off by more than LEVELS.
ALLOWED = 0.005
LEVELS = 12

_CORNER = view_from((0.6, 0.7, 1.9), (3.4, 2.3, -1.1), size=SIZE)
_ABOVE = view_from((-3.5, -4.0, 5.5), (7, 7, -4.6), size=SIZE, field_of_view=55)
_UNDER_THE_TABLE = view_from((2.4, 2.2, 0.5), (1.4, 0.9, 0.05), size=SIZE)

CASES: dict[str, tuple[View, Settings, dict[str, bool], int]] = {
    "corner": (_CORNER, Settings(), {}, 0),
    "corner_gl33": (_CORNER, Settings(), {"force_gl33": True}, 0),
    "corner_smooth": (_CORNER, Settings(), {}, 4),
    "corner_fog": (_CORNER, Settings(fog=0.15), {}, 0),
    "corner_objects": (_CORNER, Settings(colours="objects"), {}, 0),
    "corner_objects_gl33": (_CORNER, Settings(colours="objects"), {"force_gl33": True}, 0),
    "corner_levels": (_CORNER, Settings(colours="levels", strategy="frustum", pixel_error=8), {}, 0),
    "above": (_ABOVE, Settings(), {}, 0),
    "above_full": (_ABOVE, Settings(strategy="none"), {}, 0),
    "under_the_table": (_UNDER_THE_TABLE, Settings(strategy="frustum"), {}, 0),
}


@pytest.fixture(scope="module")
def model(room: object) -> ShownModel:  # noqa: F811
    """The room as the player sees it."""
    return shown_model(room)


@pytest.mark.parametrize("name", CASES)
def test_picture(context: moderngl.Context, model: ShownModel, name: str, tmp_path: Path) -> None:  # noqa: F811
    view, settings, force, samples = CASES[name]
    able = abilities(context, **force)
    target = Target(context, SIZE, samples=samples, reversed_depth=able.reversed_depth)
    walk = Walkthrough(model, context, able, settings)
    walk.frame(view, target)
    picture = target.read()[..., :3]
    walk.close()
    target.release()
    check(context, name, picture, tmp_path)


def test_text(context: moderngl.Context, tmp_path: Path) -> None:  # noqa: F811
    target = Target(context, SIZE, samples=0, reversed_depth=False)
    overlay = TextOverlay(context, 14)
    target.framebuffer.use()
    target.framebuffer.clear(0.4, 0.5, 0.6, 1.0)
    rows = [("frames/s", "60"), ("triangles", "1,234"), ("± · °", "more…")]
    overlay.draw(rows, target.framebuffer, SIZE, "top left")
    picture = target.read()[..., :3]
    overlay.release()
    target.release()
    check(context, "text", picture, tmp_path)


def check(context: moderngl.Context, name: str, picture: np.ndarray, tmp_path: Path) -> None:  # noqa: F811
    """Compares with the golden picture of that name, or replaces it if that was asked for."""
    file = IMAGES / f"{name}.png"
    if os.environ.get("VLOD_REGENERATE_GOLDEN"):
        IMAGES.mkdir(exist_ok=True)
        Image.fromarray(np.ascontiguousarray(picture)).save(file, optimize=True)
    if "llvmpipe" not in context.info["GL_RENDERER"]:
        pytest.skip(f"golden pictures are compared on llvmpipe only, this is {context.info['GL_RENDERER']}")
    with Image.open(file) as image:
        golden = np.array(image.convert("RGB"))
    assert golden.shape == picture.shape
    off = np.abs(golden.astype(np.int16) - picture)
    part = float((off.max(axis=2) > LEVELS).mean())
    if part > ALLOWED or off.mean() > 1.5:
        shown = tmp_path / f"{name}_difference.png"
        Image.fromarray(np.concatenate([golden, picture, np.minimum(off * 8, 255).astype(np.uint8)], axis=1)).save(
            shown
        )
        pytest.fail(
            f"{100 * part:.2f} % of {name} differs: golden, drawn and eight times the difference are in {shown}"
        )
