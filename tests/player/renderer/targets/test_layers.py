"""What can be seen through: mixed as light is, whatever the order, the culling, the samples and the OpenGL path."""

from __future__ import annotations

from pathlib import Path

import moderngl
import numpy as np
import pytest

from player.renderer.context import abilities
from player.renderer.targets.target import Target
from player.shown_model import ShownModel, shown_model
from player.walkthrough import Settings, Walkthrough
from tests.player.conftest import UP, draw, view_from
from tests.storage.tiny_store import TinyPart, box_part, make_store, room_parts

_PATHS = [{}, {"force_gl33": True}, {"force_plain_depth": True}]
_NAMES = ["4.3", "3.3", "plain depth"]
_SIZE = (96, 64)
_EAST = view_from((0.5, 3, 1.5), (1, 0, 0), size=_SIZE)

Rgba = tuple[int, int, int, int]
RED, CLEAR_GREEN, CLEAR_BLUE = (220, 30, 30, 255), (40, 200, 90, 110), (30, 60, 220, 60)


def sheet(x: float, lo: tuple[float, float], hi: tuple[float, float], colour: Rgba, name: str = "sheet") -> TinyPart:
    """A rectangle across the x axis, from (y, z) `lo` to `hi`, seen from both sides."""
    corners = np.array([(x, lo[0], lo[1]), (x, hi[0], lo[1]), (x, hi[0], hi[1]), (x, lo[0], hi[1])], float)
    return TinyPart(name, [(corners, np.array([[0, 1, 2], [0, 2, 3]], np.uint32))], colour=colour)


def frame() -> list[TinyPart]:
    """Two small boxes in opposite corners, so that all models here are as large: 8 x 6 x 3 units."""
    return [box_part("low", (0, 0, 0), (0.1, 0.1, 0.1)), box_part("high", (7.9, 5.9, 2.9), (8, 6, 3))]


def made(root: Path, *parts: TinyPart) -> ShownModel:
    """The model of these parts within `frame`."""
    return shown_model(make_store(root, [*frame(), *parts], depth=1))


def light(picture: np.ndarray) -> np.ndarray:
    """Linear light of a picture's colours."""
    return (picture[..., :3] / 255.0) ** 2


def mixed(front: np.ndarray, behind: np.ndarray, alpha: float) -> np.ndarray:
    """Levels of 255 of a surface before something, each alone being so bright."""
    return 255 * np.sqrt(alpha * light(front) + (1 - alpha) * light(behind))


@pytest.mark.parametrize("samples", [0, 2, 4])
@pytest.mark.parametrize("force", _PATHS, ids=_NAMES)
def test_a_pane_is_mixed_with_what_is_behind_it(
    context: moderngl.Context, tmp_path: Path, force: dict[str, bool], samples: int
) -> None:
    wall = sheet(6, (0, 0), (6, 3), RED, "wall")
    extent = (2, (2, 0.8), (4.2, 2.1))
    for number, settings in enumerate((Settings(), Settings(fog=0.2), Settings(sky=False), Settings(strategy="none"))):
        pictures = [
            draw(
                context, made(tmp_path / f"{number}{part}", *parts), _EAST, settings=settings, samples=samples, **force
            )
            for part, parts in enumerate(
                ([wall], [wall, sheet(*extent, (*CLEAR_GREEN[:3], 255))], [wall, sheet(*extent, CLEAR_GREEN)])
            )
        ]
        behind, solid, through = pictures
        changed = (solid != behind).any(axis=2)
        inner = changed.copy()
        inner[1:-1, 1:-1] &= changed[2:, 1:-1] & changed[:-2, 1:-1] & changed[1:-1, 2:] & changed[1:-1, :-2]
        inner &= np.isin(behind[..., 3], (0, 255))  # of the wall's edge, each sample is mixed for itself
        assert 0.1 < inner.mean() < 0.9
        expected = mixed(solid, behind, CLEAR_GREEN[3] / 255)
        assert np.abs(through[..., :3] - expected)[inner].max() <= 1.5
        assert np.array_equal(through[~changed], behind[~changed])
        assert np.array_equal(through[..., 3], behind[..., 3])  # what is covered is not a matter of panes


@pytest.mark.parametrize("force", _PATHS, ids=_NAMES)
def test_two_panes_are_told_apart_by_alpha_and_distance(
    context: moderngl.Context, tmp_path: Path, force: dict[str, bool]
) -> None:
    """The mixture of the paper's equation 2, by hand, in the middle of the picture."""
    wall = sheet(6, (0, 0), (6, 3), RED, "wall")
    panes = [(2.5, CLEAR_GREEN), (4.5, CLEAR_BLUE)]
    alone = [
        draw(context, made(tmp_path / f"{x}", wall, sheet(x, (0, 0), (6, 3), (*c[:3], 255))), _EAST, **force)
        for x, c in panes
    ]
    behind = draw(context, made(tmp_path / "none", wall), _EAST, **force)
    model = made(tmp_path / "both", wall, *(sheet(x, (0, 0), (6, 3), c) for x, c in panes))
    alphas = np.array([c[3] / 255 for _, c in panes])
    weights = alphas / (np.array([x for x, _ in panes]) - _EAST.position[0])
    colour = sum(w * light(picture) for w, picture in zip(weights, alone, strict=True)) / weights.sum()
    through = np.prod(1 - alphas)
    expected = 255 * np.sqrt(light(behind) * through + colour * (1 - through))
    found = draw(context, model, _EAST, **force)
    middle = (slice(28, 36), slice(44, 52))
    assert np.abs(found[..., :3] - expected)[middle].max() <= 1.5


def _panes(rng: np.random.Generator, count: int) -> list[TinyPart]:
    """Panes of all colours and places, flat ones and closed boxes."""
    parts = []
    for number in range(count):
        colour = (*rng.integers(0, 256, 3).tolist(), int(rng.integers(1, 255)))
        lo = rng.random(3) * (6, 4, 2) + (1, 0, 0)
        if number % 2:
            parts.append(box_part(f"{number}", lo, lo + rng.random(3) * (1, 2, 1) + 0.01, segments=(2,), colour=colour))
        else:
            parts.append(sheet(lo[0], lo[1:], lo[1:] + rng.random(2) * (2, 1) + 0.1, colour, f"{number}"))
    return parts


@pytest.mark.parametrize("samples", [0, 4])
@pytest.mark.parametrize("force", _PATHS[:2], ids=_NAMES[:2])
def test_the_order_makes_no_difference(
    context: moderngl.Context, tmp_path: Path, force: dict[str, bool], samples: int
) -> None:
    rng = np.random.default_rng(4)
    parts = [*_panes(rng, 30), *room_parts()]
    pictures = []
    for number in range(3):
        model = shown_model(make_store(tmp_path / f"{number}", parts, depth=1))
        pictures.append(draw(context, model, _EAST, settings=Settings(strategy="none"), samples=samples, **force))
        rng.shuffle(parts)
    for other in pictures[1:]:
        assert np.abs(other.astype(int) - pictures[0]).max() <= 1


def test_all_paths_draw_the_same_picture(context: moderngl.Context, tmp_path: Path) -> None:
    model = shown_model(make_store(tmp_path / "s", [*_panes(np.random.default_rng(5), 30), *room_parts()], depth=1))
    for settings in (Settings(), Settings(colours="objects"), Settings(fog=0.3)):
        pictures = [draw(context, model, _EAST, settings=settings, **force) for force in _PATHS]
        for other in pictures[1:]:
            off = np.abs(other.astype(int) - pictures[0]).max(axis=2)
            assert (off > 1).mean() < 0.001


def test_culling_makes_no_difference(context: moderngl.Context, tmp_path: Path) -> None:
    """Every pane that a wall hides is not in the cells' lists; nor are those behind the eye in a frustum's."""
    rng = np.random.default_rng(6)
    wall = box_part("wall", (5, 0, 0), (5.2, 6, 3), segments=(6,))
    behind = [sheet(x, (0, 0), (6, 3), CLEAR_BLUE, f"behind {x}") for x in (5.5, 6.5, 7.5)]
    parts = [*frame(), wall, *behind, *_panes(rng, 20)]
    last = 3 + len(behind)
    hidden = set(range(3, last))
    store = make_store(
        tmp_path / "s",
        parts,
        depth=1,
        visible=lambda geometry, _, cut: cut[~np.isin(geometry.drawables["node"][cut], list(hidden))],
    )
    model = shown_model(store)
    view = view_from((0.5, 3, 1.5), (1, 0.1, 0), size=_SIZE)
    for samples in (0, 4):
        full = draw(context, model, view, settings=Settings(strategy="none"), samples=samples)
        for strategy in ("vlod", "frustum"):
            culled = draw(context, model, view, settings=Settings(strategy=strategy), samples=samples)
            assert np.abs(culled.astype(int) - full).max() <= 1


def test_edges_of_what_stands_before_a_pane_have_no_fringe(context: moderngl.Context, tmp_path: Path) -> None:
    """A black post before a dark pane before a bright wall: no edge is brighter than both its sides."""
    model = made(
        tmp_path / "s",
        sheet(6, (0, 0), (6, 3), (255, 255, 255, 255), "wall"),
        sheet(4, (0, 0), (6, 3), (0, 0, 0, 245), "pane"),
        sheet(2, (2.93, 0.0), (3.21, 3), (0, 0, 0, 255), "post"),
    )
    plain, smooth = (draw(context, model, _EAST, samples=n)[_SIZE[1] // 2, :, :3].astype(int) for n in (0, 4))
    near = np.stack([plain[:-2], plain[1:-1], plain[2:]])
    assert (smooth[1:-1] <= near.max(axis=0) + 1).all()
    assert (smooth[1:-1] >= near.min(axis=0) - 1).all()
    assert (np.abs(smooth - plain).max(axis=1) > 3).sum() >= 4  # both edges of the post, and of the pane


def test_the_unit_makes_no_difference(context: moderngl.Context, tmp_path: Path) -> None:
    pictures = []
    for scale in (1.0, 1000.0):
        parts = [
            TinyPart(p.name, [(v * scale, t) for v, t in p.levels], [e * scale for e in p.errors], colour=p.colour)
            for p in [*frame(), *_panes(np.random.default_rng(7), 12)]
        ]
        view = view_from((0.5 * scale, 3 * scale, 1.5 * scale), (1, 0, 0), size=_SIZE, near=scale / 1000)
        pictures.append(draw(context, shown_model(make_store(tmp_path / f"{scale}", parts, depth=1)), view))
    off = np.abs(pictures[1].astype(int) - pictures[0]).max(axis=2)
    assert (off > 2).mean() < 0.01  # edges lie on other points of the grid


def test_both_sides_are_drawn_from_within_and_from_without(context: moderngl.Context, tmp_path: Path) -> None:
    model = made(tmp_path / "s", box_part("case", (2, 1, 0.5), (5, 5, 2.5), segments=(1,), colour=(200, 20, 20, 128)))
    inside, outside = view_from((3.5, 3, 1.5), (1, 0, 0), size=_SIZE), view_from((0.5, 3, 1.5), (1, 0, 0), size=_SIZE)
    black = Settings(sky=False)
    once, twice = (draw(context, model, view, settings=black)[32, 48, 0] for view in (inside, outside))
    assert 0 < once < twice  # one side of it, and two, before nothing


def test_the_objects_colours_can_be_seen_through_as_well(context: moderngl.Context, tmp_path: Path) -> None:
    model = made(tmp_path / "s", sheet(6, (0, 0), (6, 3), RED), sheet(2, (0, 0), (6, 3), CLEAR_BLUE))
    plain, tinted = (draw(context, model, _EAST, settings=Settings(colours=name)) for name in ("model", "objects"))
    assert np.abs(plain.astype(int) - tinted)[32, 48, :3].max() > 20
    without = made(tmp_path / "t", sheet(6, (0, 0), (6, 3), RED))
    behind = draw(context, without, _EAST, settings=Settings(colours="objects"))[32, 48, :3].astype(int)
    solid = made(tmp_path / "u", sheet(6, (0, 0), (6, 3), RED), sheet(2, (0, 0), (6, 3), (*CLEAR_BLUE[:3], 255)))
    front = draw(context, solid, _EAST, settings=Settings(colours="objects"))[32, 48, :3].astype(int)
    expected = mixed(front, behind, CLEAR_BLUE[3] / 255)
    assert np.abs(tinted[32, 48, :3] - expected).max() <= 1.5


@pytest.mark.parametrize("force", _PATHS, ids=_NAMES)
def test_a_pane_stops_who_walks(context: moderngl.Context, tmp_path: Path, force: dict[str, bool]) -> None:
    model = made(tmp_path / "s", sheet(6, (0, 0), (6, 3), RED), sheet(2.5, (0, 0), (6, 3), CLEAR_BLUE))
    able = abilities(context, **force)
    walk = Walkthrough(model, context, able, Settings())
    probe = Target(context, (8, 8), samples=0, reversed_depth=able.reversed_depth)
    walk.packs.need(np.arange(len(model.store.packs)), wait=True)
    found = walk.distance(np.array([0.5, 3, 1.5]), np.array([1.0, 0, 0]), UP, probe)
    assert found == pytest.approx(2.0, rel=0.02)
    walk.close()
    probe.release()


def test_a_target_draws_models_with_and_without_panes_by_turns(context: moderngl.Context, tmp_path: Path) -> None:
    """Nothing of one frame is left in the next: neither sums, nor a blend function, nor a depth that is not written."""
    model = made(tmp_path / "s", sheet(6, (0, 0), (6, 3), RED), sheet(2.5, (0, 0), (6, 3), CLEAR_BLUE))
    away = view_from((3, 3, 1.5), (1, 0, 0), size=_SIZE)
    able = abilities(context)
    for samples in (0, 4):
        target = Target(context, _SIZE, samples=samples, reversed_depth=able.reversed_depth, see_through=True)
        walk = Walkthrough(model, context, able, Settings(strategy="frustum"))
        pictures = []
        for view in (_EAST, away, _EAST, away):
            walk.frame(view, target)
            pictures.append(target.read())
        assert context.error == "GL_NO_ERROR"
        assert np.array_equal(pictures[0], pictures[2])
        assert np.array_equal(pictures[1], pictures[3])
        assert np.array_equal(
            pictures[1],
            draw(context, made(tmp_path / f"{samples}", sheet(6, (0, 0), (6, 3), RED)), away, samples=samples),
        )
        walk.close()
        target.release()


def test_a_model_without_panes_has_neither_layers_nor_a_second_list(
    context: moderngl.Context, model: ShownModel
) -> None:
    assert not model.see_through
    walk = Walkthrough(model, context, abilities(context), Settings())
    walk.packs.need(np.arange(len(model.store.packs)), wait=True)
    assert walk.renderer.prepare(np.flatnonzero(model.store.drawables["level"] == 0), None).see_through is None
    walk.close()
