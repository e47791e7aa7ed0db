"""What the player's tests share: small stores, and a context if there is an OpenGL driver."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import moderngl
import numpy as np
import pytest

from player.camera.view import View, looking
from player.errors import GraphicsError
from player.renderer.context import abilities, headless_context
from player.renderer.targets.target import Target
from player.shown_model import ShownModel, shown_model
from player.walkthrough import Settings, Walkthrough
from storage.geometry_reader import Geometry
from storage.store import Store
from tests.storage.tiny_store import make_store, room_parts

UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="session")
def room(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """A room of 8 x 6 x 3 units with 64 cells, each of which sees its whole cut."""
    return make_store(tmp_path_factory.mktemp("room") / "store", room_parts(), depth=2)


@pytest.fixture(scope="session")
def model(room: Store) -> ShownModel:
    """The room as the player sees it."""
    return shown_model(room)


@pytest.fixture(scope="session")
def odd_room(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """The room where cells see only what lies in their half, and some were not computed."""

    def visible(geometry: Geometry, cell: np.ndarray, cut: np.ndarray) -> np.ndarray:
        middle = geometry.drawables["lo"][cut, 0] < 4
        return cut[middle] if cell["lo"][0] < 3 else cut

    return make_store(
        tmp_path_factory.mktemp("odd") / "store", room_parts(), depth=2, visible=visible, uncomputed={0, 1, 63}
    )


@pytest.fixture(scope="module")
def context() -> Iterator[moderngl.Context]:
    """An OpenGL context without a window."""
    try:
        made = headless_context()
    except GraphicsError as error:
        pytest.skip(str(error))
    yield made
    made.release()


def view_from(
    position: tuple[float, float, float],
    direction: tuple[float, float, float],
    *,
    size: tuple[int, int] = (160, 90),
    field_of_view: float = 70.0,
    near: float = 0.001,
    far: float = 100.0,
) -> View:
    """A view with z up."""
    return View(np.array(position), looking(direction, UP), field_of_view, *size, near, far)


def inside_view(size: tuple[int, int] = (160, 90)) -> View:
    """From a corner of the room to the other."""
    return view_from((0.6, 0.7, 1.9), (3.4, 2.3, -1.1), size=size)


def draw(
    context: moderngl.Context,
    model: ShownModel,
    view: View,
    *,
    settings: Settings | None = None,
    samples: int = 0,
    **force: bool,
) -> np.ndarray:
    """One picture (height, width, 4)."""
    able = abilities(context, **force)
    target = Target(
        context,
        (view.width, view.height),
        samples=samples,
        reversed_depth=able.reversed_depth,
        see_through=model.see_through,
    )
    walk = Walkthrough(model, context, able, settings or Settings())
    try:
        walk.frame(view, target)
        assert context.error == "GL_NO_ERROR"
        return target.read()
    finally:
        walk.close()
        target.release()
        assert context.error == "GL_NO_ERROR"


def store_path(store: Store) -> Path:
    """The directory of a store."""
    return Path(store.files.url.removeprefix("file://"))
