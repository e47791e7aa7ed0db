"""One place to add a thing: a strategy, colours, a way to steer, a tour. Each is a file and one line in a list."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace

import moderngl
import pytest
from click.testing import CliRunner

from player import colouring, commands, options, strategies, tour
from player.camera import steering
from player.camera.path import read_path
from player.offers import Offer, explained, named, names
from player.shells.keys import help_rows, key_table
from player.shown_model import ShownModel
from player.walkthrough import Settings
from storage.base.errors import ParameterError
from storage.store import Store
from tests.player.conftest import store_path
from tests.player.shells.test_headless import played, walk_along

#: Each in a file of its own: what a newcomer would write.
TOYS = """
import numpy as np

from player.camera.path import CameraPath
from player.camera.view import boxes_between, boxes_in_frustum
from player.strategies.strategy import Choice


class Largest:
    \"\"\"Draws the objects of which the box is largest.\"\"\"

    def __init__(self, model, *, pixel_error, wait):
        self.pixel_error = pixel_error
        finest = model.store.drawables[model.first_drawable]
        size = (finest["hi"] - finest["lo"]).prod(axis=1)
        self.ids = np.sort(model.first_drawable[np.argsort(-size)[:3]]).astype(np.int64)

    def choose(self, view):
        return Choice(self.ids, -1, computed=False)

    def ahead(self, view, motion):
        return None

    def close(self):
        pass


def red(nodes, drawables):
    return np.tile(np.array([255, 0, 0, 255], np.uint8), (len(drawables), 1))


class Crawl:
    def __init__(self, surroundings, *, eye_height):
        pass

    def turn(self, camera, right, up):
        camera.turn(right, up)

    def move(self, camera, seconds):
        camera.position = camera.position + camera.asked(camera.level, seconds) / 10


def standstill(model, known, *, frames, seed):
    middle = (model.lo + model.hi) / 2
    return CameraPath(np.arange(frames) / 25.0, np.tile(middle, (frames, 1)), np.tile([0.0, 0, 0, 1], (frames, 1)))
"""


@pytest.fixture
def toys(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    """The toys in a module, and one line for each in its list."""
    (tmp_path / "toys.py").write_text(TOYS)
    monkeypatch.syspath_prepend(tmp_path)
    lists: list[tuple[ModuleType, str, Offer]] = [
        (strategies, "STRATEGIES", Offer("largest", "the largest boxes", "toys:Largest")),
        (colouring, "COLOURINGS", Offer("red", "nothing but red", "toys:red")),
        (steering, "STEERINGS", Offer("crawl", "crawling", "toys:Crawl")),
        (tour, "TOURS", Offer("standstill", "no motion at all", "toys:standstill")),
    ]
    for module, name, offer in lists:
        monkeypatch.setattr(module, name, (*getattr(module, name), offer))
    for module in (options, commands):
        importlib.reload(module)
    yield
    monkeypatch.undo()
    sys.modules.pop("toys", None)
    for module in (options, commands):
        importlib.reload(module)


@pytest.mark.usefixtures("toys")
def test_toys_are_in_options_keys_and_help(room: Store, tmp_path: Path) -> None:
    told = CliRunner().invoke(commands.play, ["--help"]).stdout
    for name, shows in (("largest", "the largest boxes"), ("red", "nothing but red"), ("standstill", "no motion")):
        assert name in told
        assert shows in " ".join(told.split())
    rows = dict(help_rows(key_table()))
    keys = range(1, len(strategies.STRATEGIES) + 1)
    assert rows["  ".join(map(str, keys))] == f"strategy: {', '.join(names(strategies.STRATEGIES))}"
    assert rows["G"] == " or ".join(names(steering.STEERINGS))
    assert "red" in rows["C"]
    asked: list[str] = []
    for row in key_table():
        if f"NUMBER_{keys[-1]}" in row.actions:
            row.actions[f"NUMBER_{keys[-1]}"](SimpleNamespace(use_strategy=asked.append))  # type: ignore[arg-type]
    assert asked == ["largest"]
    path = tmp_path / "p.json"
    arguments = [str(store_path(room)), "--tour", "standstill", "--frames", "3", "-o", str(path)]
    assert CliRunner().invoke(commands.path, arguments, catch_exceptions=False).exit_code == 0
    assert (read_path(path).positions == read_path(path).positions[0]).all()


@pytest.mark.usefixtures("toys")
def test_toys_draw(model: ShownModel, context: moderngl.Context, tmp_path: Path) -> None:
    pictures, report = played(model, walk_along(3), Settings(strategy="largest", colours="red"))
    for row, picture in zip(report.content["frames"], pictures, strict=True):
        assert (row["strategy"], row["drawables"]) == ("largest", 3)
        surface = picture[picture[..., 3] == 255]
        assert len(surface)
        assert (surface[:, 0] > surface[:, 1]).all()
    done = CliRunner().invoke(
        commands.play,
        [str(store_path(model.store)), "--headless", "--json", "--strategy", "largest", "--tour", "standstill",
         "--tour-frames", "2", "--size", "32x18"],
        catch_exceptions=False,
    )  # fmt: skip
    assert done.exit_code == 0


@pytest.mark.parametrize(
    "offers", [strategies.STRATEGIES, colouring.COLOURINGS, steering.STEERINGS, tour.TOURS], ids=lambda o: o[0].name
)
def test_what_is_offered_is_there(offers: tuple[Offer, ...]) -> None:
    assert len(set(names(offers))) == len(offers)
    for offer in offers:
        assert callable(offer.load())
        assert named(offers, offer.name, "thing") is offer
        assert f"{offer.name}: {offer.shows}" in explained(offers)


def test_what_is_not_offered_is_refused_by_name() -> None:
    with pytest.raises(ParameterError, match="there is no strategy 'magic': give one of vlod, frustum, none"):
        named(strategies.STRATEGIES, "magic", "strategy")


def test_lists_are_light() -> None:
    """Help comes at once: naming what there is imports none of it."""
    import subprocess

    said = "import player.commands, sys; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", said], check=True, capture_output=True, text=True).stdout.split()
    assert {"numpy", "numba", "moderngl", "PIL"}.isdisjoint(loaded)
