"""The renderer against rays: what is drawn, where, in front of what; the same on every OpenGL path."""

from __future__ import annotations

from pathlib import Path

import moderngl
import numpy as np
import pytest

from player.camera.view import View, looking
from player.renderer.context import abilities
from player.renderer.facet_table import CellBox
from player.renderer.targets.target import Target
from player.shown_model import ShownModel, shown_model
from player.walkthrough import Settings, Walkthrough
from storage.store import Store
from tests.player.conftest import UP, draw, inside_view, view_from
from tests.storage.tiny_store import TinyPart, box_part, make_store

_PATHS = [{}, {"force_gl33": True}, {"force_plain_depth": True}]


def first_hits(store: Store, view: View, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """By brute force, for the centre of each pixel: distance along the view (inf: nothing), the drawable (-1: none).

    Backs of one-sided drawables are not seen.
    """
    half = np.tan(np.radians(view.field_of_view) / 2)
    x = ((np.arange(view.width) + 0.5) / view.width * 2 - 1) * half * view.width / view.height
    y = (1 - (np.arange(view.height) + 0.5) / view.height * 2) * half
    rays = np.stack([*np.meshgrid(x, y), -np.ones((view.height, view.width))], axis=-1).reshape(-1, 3)
    rays = rays @ view.rotation.T
    depth = np.full(len(rays), np.inf)
    owner = np.full(len(rays), -1)
    for drawable in ids:
        mesh = store.mesh(int(drawable))
        for a, b, c in mesh.positions[mesh.triangles].astype(float):
            e1, e2, to = b - a, c - a, view.position - a
            p = np.cross(rays, e2)
            determinant = p @ e1
            facing = determinant > 1e-12 if store.drawables[drawable]["one_sided"] else np.abs(determinant) > 1e-12
            with np.errstate(divide="ignore", invalid="ignore"):
                u = (p @ to) / determinant
                q = np.cross(to, e1)
                v = (rays @ q) / determinant
                t = (e2 @ q) / determinant
            hit = facing & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > view.near) & (t < depth)
            depth[hit], owner[hit] = t[hit], drawable
    return depth.reshape(view.height, -1), owner.reshape(view.height, -1)


def _edges(owner: np.ndarray) -> np.ndarray:
    """Pixels next to another drawable, where rounding may go either way."""
    edge = np.zeros(owner.shape, bool)
    padded = np.pad(owner, 1, mode="edge")
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            edge |= padded[1 + dy : 1 + dy + owner.shape[0], 1 + dx : 1 + dx + owner.shape[1]] != owner
    return edge


@pytest.mark.parametrize("force", _PATHS, ids=["4.3", "3.3", "plain depth"])
@pytest.mark.parametrize("outside", [False, True])
def test_coverage_and_order_are_what_rays_see(
    context: moderngl.Context, model: ShownModel, force: dict[str, bool], outside: bool
) -> None:
    size = (64, 36)
    view = view_from((-6, -5, 6), (10, 8, -5), size=size) if outside else inside_view(size)
    picture = draw(context, model, view, settings=Settings(strategy="none"), **force)
    store = model.store
    ids = np.flatnonzero(store.drawables["level"] == 0)
    depth, owner = first_hits(store, view, ids)
    sure = ~_edges(owner)
    assert set(np.unique(picture[..., 3])) <= {0, 255}
    assert np.array_equal((picture[..., 3] == 255)[sure], np.isfinite(depth)[sure])
    assert sure.mean() > 0.7
    parts = np.array([store.part_names[store.nodes[store.drawables[d]["node"]]["part"]] for d in ids])
    node_part = {int(d): str(name) for d, name in zip(ids, parts, strict=True)}
    chairs = np.vectorize(lambda d: d >= 0 and node_part[int(d)] == "chair")(owner) & sure
    table = np.vectorize(lambda d: d >= 0 and node_part[int(d)] == "table")(owner) & sure
    if chairs.any():
        assert (picture[chairs][:, 2].astype(int) > picture[chairs][:, 0]).all()  # chairs are blue
    if table.any():
        assert (picture[table][:, 0].astype(int) > picture[table][:, 2]).all()  # the table is brown


def test_all_paths_draw_the_same_picture(context: moderngl.Context, model: ShownModel) -> None:
    pictures = [draw(context, model, inside_view(), **force) for force in _PATHS]
    for other in pictures[1:]:
        off = np.abs(other.astype(int) - pictures[0]).max(axis=2)
        assert (off > 2).mean() < 0.001


def test_leaving_out_facets_that_turn_their_backs_changes_no_pixel(
    context: moderngl.Context, model: ShownModel
) -> None:
    """From all over some cells, their corners included, in random directions; with mirrored instances in sight."""
    rng = np.random.default_rng(8)
    store, size, left_out = model.store, (96, 54), 0
    for force in ({}, {"force_gl33": True}):
        able = abilities(context, **force)
        target = Target(context, size, samples=0, reversed_depth=able.reversed_depth)
        walk = Walkthrough(model, context, able, Settings())
        for number in rng.choice(len(store.cells), 12, replace=False).tolist():
            cell, ids = store.cells[number], store.vlod(number)
            walk.packs.need(np.arange(len(store.packs)), wait=True)
            for part in (rng.random(3), rng.integers(0, 2, 3)):
                place = tuple(cell["lo"] + part * (cell["hi"] - cell["lo"]))
                view = view_from(place, tuple(rng.normal(size=3)), size=size, near=0.01)
                pictures = []
                for box in (None, CellBox(cell["lo"], cell["hi"])):
                    draws = walk.renderer.prepare(ids, box)
                    walk.renderer.draw(view, draws, target)
                    pictures.append(target.read())
                assert np.array_equal(*pictures)
                left_out += draws.turned
        walk.close()
        target.release()
    assert left_out > 0


def test_background_is_exactly_transparent_with_and_without_sky(context: moderngl.Context, model: ShownModel) -> None:
    away = view_from((4, 3, 10), (0.1, 0, 1))
    for sky in (True, False):
        picture = draw(context, model, away, settings=Settings(sky=sky))
        assert (picture[..., 3] == 0).all()
        assert picture[..., :3].any() == sky


def test_samples_smooth_the_edges_and_cover_the_same(context: moderngl.Context, model: ShownModel) -> None:
    single = draw(context, model, inside_view())
    smooth = draw(context, model, inside_view(), samples=4)
    assert (np.abs(single.astype(int) - smooth).max(axis=2) > 8).mean() < 0.1
    assert not np.array_equal(single, smooth)
    assert ((smooth[..., 3] > 0) >= (single[..., 3] > 0)).all()


def test_fog_fades_into_the_horizon(context: moderngl.Context, model: ShownModel) -> None:
    clear = draw(context, model, inside_view())
    foggy = draw(context, model, inside_view(), settings=Settings(fog=2.0))
    surface = clear[..., 3] > 0
    assert foggy[surface][:, :3].std() < 0.3 * clear[surface][:, :3].std()


def test_nothing_trembles_far_from_the_origin(context: moderngl.Context, tmp_path: Path) -> None:
    pictures = []
    for offset in (0.0, 2.0**20):
        parts = [
            box_part("floor", (offset, offset, 0), (offset + 8, offset + 8, 0.5), segments=(2,)),
            box_part("box", (offset + 3, offset + 3, 0.5), (offset + 5, offset + 5, 2), segments=(2,)),
        ]
        store = make_store(tmp_path / f"{offset}", parts, depth=1)
        shift = np.array([offset, offset, 0])
        view = View(np.array([1.1, 0.7, 2.3]) + shift, looking((3, 3.1, -1), UP), 60, 160, 90, 0.01, 100)
        pictures.append(draw(context, shown_model(store), view))
    assert np.array_equal(pictures[0][..., 3], pictures[1][..., 3])
    assert np.abs(pictures[0].astype(int) - pictures[1]).max() <= 2


def test_far_surfaces_keep_their_order(context: moderngl.Context, tmp_path: Path) -> None:
    """Two sheets 1 unit apart, 3000 units away, with the near plane a hair from the eye."""
    sheet = np.array([[0, 0, 0], [4000, 0, 0], [4000, 4000, 0], [0, 4000, 0]], float)
    triangles = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
    parts = [
        TinyPart("low", [(sheet, triangles)], colour=(250, 20, 20, 255)),
        TinyPart("high", [(sheet + UP, triangles)], colour=(20, 20, 250, 255)),
    ]
    model = shown_model(make_store(tmp_path / "sheets", parts, depth=1))
    view = view_from((2000, 2000, 3000), (0.01, 0, -1), near=0.003, field_of_view=50)
    if not abilities(context).reversed_depth:
        pytest.skip("this driver has no reversed depth")
    picture = draw(context, model, view, settings=Settings(strategy="none"))
    seen = picture[picture[..., 3] == 255].astype(int)
    assert len(seen)
    assert (seen[:, 2] > seen[:, 0]).all()


def test_one_sided_backs_are_not_drawn_but_two_sided_ones_are(context: moderngl.Context, tmp_path: Path) -> None:
    for one_sided, visible in ((True, False), (False, True)):
        part = box_part("box", (0, 0, 0), (4, 4, 4), segments=(1,))
        part = TinyPart(part.name, part.levels, part.errors, one_sided=one_sided, normals=part.normals)
        model = shown_model(make_store(tmp_path / str(one_sided), [part], depth=1))
        picture = draw(context, model, view_from((2, 2, 2), (1, 0.2, 0)))
        assert (picture[..., 3] == 255).all() == visible
        assert (picture[..., 3] == 0).all() != visible


def test_the_drawn_levels_look_like_the_finest(context: moderngl.Context, model: ShownModel) -> None:
    drawn = draw(context, model, inside_view(), settings=Settings(strategy="vlod", pixel_error=4))
    full = draw(context, model, inside_view(), settings=Settings(strategy="none"))
    assert (np.abs(drawn.astype(int) - full).max(axis=2) > 16).mean() < 0.01


def test_distance_along_a_direction(context: moderngl.Context, model: ShownModel) -> None:
    for force in ({}, {"force_gl33": True}):
        able = abilities(context, **force)
        walk = Walkthrough(model, context, able, Settings())
        target = Target(context, (32, 18), samples=0, reversed_depth=able.reversed_depth)
        probe = Target(context, (8, 8), samples=0, reversed_depth=able.reversed_depth)
        walk.frame(inside_view((32, 18)), target)
        here = np.array([1.5, 1.2, 1.6])
        walk.packs.need(np.arange(len(model.store.packs)), wait=True)
        assert walk.distance(here, -UP, np.array([1.0, 0, 0]), probe) == pytest.approx(1.6, rel=0.02)
        assert walk.distance(here, np.array([-1.0, 0, 0]), UP, probe) == pytest.approx(1.5, rel=0.03)
        assert walk.distance(here, UP, np.array([1.0, 0, 0]), probe) == np.inf
        walk.close()
        target.release()
        probe.release()
