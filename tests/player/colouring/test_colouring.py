"""Colours that show the hierarchy: the same on every run, different where they should be."""

from __future__ import annotations

import moderngl
import numpy as np

from player.colouring import COLOURINGS
from player.colouring.by_level import by_level
from player.colouring.by_object import by_object
from player.colouring.tints import untinted
from player.offers import names
from player.renderer.context import abilities
from player.renderer.targets.target import Target
from player.shown_model import ShownModel
from player.walkthrough import Settings, Walkthrough
from storage.model.tables import DRAWABLE, NODE
from tests.player.conftest import inside_view


def _tree() -> tuple[np.ndarray, np.ndarray]:
    """A root over a node over two leaves, and over a leaf; every node has two levels."""
    nodes = np.zeros(5, NODE)
    nodes["end"] = [5, 4, 3, 4, 5]
    nodes["first_drawable"], nodes["levels"] = np.arange(5) * 2, 2
    drawables = np.zeros(10, DRAWABLE)
    drawables["node"], drawables["level"] = np.repeat(np.arange(5), 2), np.tile([0, 1], 5)
    return nodes, drawables


def test_objects_have_colours_of_their_own_at_all_levels() -> None:
    found = by_object(*_tree())
    assert (found[:, 3] == 255).all()
    assert (found[::2] == found[1::2]).all()
    drawables = np.zeros(2000, DRAWABLE)
    drawables["node"] = np.arange(2000)
    many = by_object(np.zeros(2000, NODE), drawables).astype(int)
    assert len(np.unique(many, axis=0)) > 1990
    assert np.abs(np.diff(many, axis=0)).sum(axis=1).min() > 60  # neighbours in the tree
    assert many[:, :3].max(axis=1).min() > 120  # none too dark for its shading to be seen


def test_levels_have_colours_by_level_and_height() -> None:
    found = by_level(*_tree())
    nodes = found.reshape(5, 2, 4)
    assert (nodes[[2, 3, 4]] == nodes[2]).all()
    assert (nodes[:2, 0] == nodes[:2, 1]).all()
    assert len(np.unique(found, axis=0)) == 4  # two levels of leaves, two heights


def test_the_models_own_colours_are_left_alone() -> None:
    assert not untinted(*_tree()).any()


def test_every_object_is_painted_and_shaded_and_the_model_comes_back(
    context: moderngl.Context, model: ShownModel
) -> None:
    view = inside_view()
    for force_gl33 in (False, True):
        able = abilities(context, force_gl33=force_gl33)
        target = Target(context, (view.width, view.height), samples=0, reversed_depth=able.reversed_depth)
        walk = Walkthrough(model, context, able, Settings(strategy="none"))
        pictures = []
        for colours in (*names(COLOURINGS), "model"):
            walk.use_colours(colours)
            walk.frame(view, target)
            pictures.append(target.read())
        walk.close()
        target.release()
        own, objects, levels, again = pictures
        assert (own == again).all()
        assert (objects[..., 3] == own[..., 3]).all()
        assert (levels != own).any(axis=2)[own[..., 3] == 255].all()
        solid = objects[objects[..., 3] == 255][:, :3].astype(int)
        hues = np.argsort(solid, axis=1) @ (9, 3, 1)
        assert len(np.unique(hues)) > 3
        assert len(np.unique(solid, axis=0)) > 50  # shaded
