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
from player.renderer.targets.target import Target
from player.renderer.text import TextOverlay
from player.shown_model import ShownModel, shown_model
from player.walkthrough import Settings
from tests.player.conftest import context, draw, room, view_from  # noqa: F401
from tests.storage.tiny_store import TinyPart, box_part, make_store

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

_PANE = view_from((1.2, 1.2, 1.9), (3, 1.6, -1.1), size=SIZE, field_of_view=60)
_CROSSING = view_from((5.6, 2.0, 1.7), (1.0, 2.6, -0.55), size=SIZE, field_of_view=65)
_ALL_GLASS = view_from((-0.8, -2.0, 3.6), (6, 6.2, -3.3), size=SIZE, field_of_view=60)

#: Pictures of `glass_parts`.
GLASS_CASES: dict[str, tuple[View, Settings, dict[str, bool], int]] = {
    "pane": (_PANE, Settings(), {}, 0),
    "pane_smooth": (_PANE, Settings(), {}, 4),
    "crossing": (_CROSSING, Settings(), {}, 0),
    "crossing_gl33": (_CROSSING, Settings(), {"force_gl33": True}, 0),
    "glass": (_ALL_GLASS, Settings(strategy="frustum"), {}, 4),
    "glass_fog": (_ALL_GLASS, Settings(strategy="frustum", fog=0.15), {}, 0),
    "glass_objects": (_ALL_GLASS, Settings(strategy="frustum", colours="objects"), {}, 0),
}


def glass_parts() -> list[TinyPart]:
    """A floor, a red box with a pane before it, and a blue and a yellow pane that cross; 8 x 6 x 3 units."""
    return [
        box_part("floor", (0, 0, -0.1), (8, 6, 0), segments=(4,), colour=(120, 110, 100, 255)),
        box_part("box", (3.4, 2, 0), (4.6, 3.2, 1.2), segments=(2,), colour=(210, 30, 30, 255)),
        box_part("pane", (2.6, 1.4, 0), (2.64, 3.0, 1.6), segments=(1,), colour=(90, 200, 170, 90)),
        box_part("blue pane", (5.2, 4.5, 0), (7.8, 4.53, 1.5), segments=(1,), colour=(40, 70, 230, 120)),
        box_part("yellow pane", (6.5, 3.2, 0), (6.53, 5.8, 1.3), segments=(1,), colour=(240, 210, 40, 120)),
    ]


@pytest.fixture(scope="module")
def glass_model(tmp_path_factory: pytest.TempPathFactory) -> ShownModel:
    """The model of `glass_parts`, of which each cell sees its whole cut."""
    return shown_model(make_store(tmp_path_factory.mktemp("glass") / "store", glass_parts(), depth=1))


@pytest.fixture(scope="module")
def model(room: object) -> ShownModel:  # noqa: F811
    """The room as the player sees it."""
    return shown_model(room)


@pytest.mark.parametrize("name", CASES)
def test_picture(context: moderngl.Context, model: ShownModel, name: str, tmp_path: Path) -> None:  # noqa: F811
    view, settings, force, samples = CASES[name]
    check(context, name, draw(context, model, view, settings=settings, samples=samples, **force)[..., :3], tmp_path)


@pytest.mark.parametrize("name", GLASS_CASES)
def test_picture_of_glass(
    context: moderngl.Context,  # noqa: F811
    glass_model: ShownModel,
    name: str,
    tmp_path: Path,
) -> None:
    view, settings, force, samples = GLASS_CASES[name]
    picture = draw(context, glass_model, view, settings=settings, samples=samples, **force)
    check(context, name, picture[..., :3], tmp_path)


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
