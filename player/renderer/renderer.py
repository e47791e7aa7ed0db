"""Draws drawables as seen from a view. Knows the GPU; knows nothing of cells, strategies or files."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from player.camera.view import View, normalised, up_vector
from player.renderer import draw_list, instances, shaders
from player.renderer.arena import Arena
from player.renderer.context import Abilities, use_depth_range
from player.renderer.draw_list import DrawLists, DrawTables
from player.renderer.facet_table import CellBox, FacetTable
from player.renderer.surfaces import MultiDraw, SingleDraws, SurfaceDrawer
from player.renderer.targets.layers import Overlay
from player.renderer.targets.target import Target


@dataclass(frozen=True)
class Style:
    """How the picture looks."""

    up: str = "y"  # the model's up axis
    fog: float = 0.0  # fading towards the horizon's colour, per model unit; 0: none
    sky: bool = True  # False: black where there is no surface


class Renderer:
    """The arena, the placements and the shaders of one store in one context."""

    def __init__(
        self, context: moderngl.Context, able: Abilities, tables: DrawTables, packs: int, matrices: NDArray[np.float64],
        step: float, style: Style,
    ) -> None:  # fmt: skip
        """packs: number of packs in the store; matrices (n, 3, 4): placements; step: model units per grid unit."""
        self.context = context
        self.able = able
        self.arena = Arena(context, packs)
        self.facets = FacetTable(len(tables.pack))
        self._tables = tables
        self._step = step
        self._style = style
        self._records = instances.record_texture(context, instances.records(matrices, step))
        make: type[MultiDraw] | type[SingleDraws] = MultiDraw if able.multi_draw else SingleDraws
        self._opaque: SurfaceDrawer = make(context, self.arena, see_through=False)
        self._see_through: SurfaceDrawer | None = None
        if tables.see_through.any():
            self._see_through = make(context, self.arena, see_through=True)
        self._overlay = Overlay(context)
        self._sky = context.program(vertex_shader=shaders.SKY[0], fragment_shader=shaders.SKY[1])
        self._sky_array = context.vertex_array(self._sky, [])
        self._last: tuple[NDArray[np.int64], CellBox | None, int, DrawLists] | None = None
        up = up_vector(style.up)
        lamp = normalised(np.roll(up, 1) * 0.45 + np.roll(up, 2) * 0.28 + up * 0.85)
        for drawer in self._drawers():
            surface = drawer.program
            surface["u_records"] = 0
            surface["u_up"] = tuple(up)
            surface["u_lamp"] = tuple(lamp)
            surface["u_fog"] = style.fog * step
            surface["u_horizon"] = shaders.HORIZON
        self._sky["u_up"] = tuple(up)
        self._sky["u_horizon"] = shaders.HORIZON

    def paint(self, tints: NDArray[np.uint8]) -> None:
        """Draws each drawable in its tint (drawables, 4): red, green, blue; alpha 0 keeps the mesh's own colours."""
        record = self._tables.record.copy()
        record["tint"] = tints
        self._tables = replace(self._tables, record=record)
        self._last = None

    def prepare(self, ids: NDArray[np.int64], cell: CellBox | None) -> DrawLists:
        """Draw commands for sorted drawable `ids`, whose packs must be in the arena; kept while nothing changes.

        cell: the eye is in this view cell, so that what it sees only from behind is left out; None: may be anywhere.
        """
        last = self._last
        if last is not None and last[1] is cell and last[2] == self.arena.version and np.array_equal(last[0], ids):
            return last[3]
        draws = draw_list.build_parted(ids, self._tables, self.arena.slab_of, self.arena.first_index, self.facets, cell)
        self._last = (ids, cell, self.arena.version, draws)
        return draws

    def draw(self, view: View, draws: DrawLists, target: Target) -> int:
        """Draws the picture, background included, and returns the number of draw calls for surfaces.

        What can be seen through is laid over the rest if the target has layers for it; else it is as solid as all else.
        """
        context, framebuffer, layers = self.context, target.framebuffer, target.layers
        framebuffer.use()
        context.viewport = (0, 0, view.width, view.height)
        context.disable(moderngl.BLEND | moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        framebuffer.clear(0.0, 0.0, 0.0, 0.0, depth=0.0 if self.able.reversed_depth else 1.0)
        use_depth_range(context, reversed_depth=self.able.reversed_depth)
        if self._style.sky:
            self._draw_sky(view)
        context.enable(moderngl.DEPTH_TEST)
        context.depth_func = ">" if self.able.reversed_depth else "<"
        camera = np.zeros((4, 4))
        camera[:3, :3] = view.rotation.T * self._step
        camera[3, 3] = 1
        clip = view.projection(self.able.reversed_depth) @ camera
        whole, rest = instances.split(view.position, self._step)
        for drawer in self._drawers():
            _write(drawer.program, "u_clip", clip.T.astype(np.float32).tobytes())
            _write(drawer.program, "u_eye_whole", whole.tobytes())
            _write(drawer.program, "u_eye_rest", rest.tobytes())
        self._records.use(0)
        calls = self._opaque.draw(draws.opaque)
        panes, pane_drawer = draws.see_through, self._see_through
        if panes is not None and layers is None:
            calls += self._opaque.draw(panes)
        elif panes is not None and layers is not None and pane_drawer is not None:
            layers.begin()
            calls += pane_drawer.draw(panes)
            layers.end()
        context.disable(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        use_depth_range(context, reversed_depth=False)
        target.resolve()
        if panes is not None and layers is not None:
            self._overlay.draw(layers, target.resolved)
        return calls

    def release(self) -> None:
        """Frees everything on the GPU."""
        for drawer in self._drawers():
            drawer.release()
        self._overlay.release()
        self._sky_array.release()
        self._sky.release()
        self._records.release()
        self.arena.release()

    def _drawers(self) -> tuple[SurfaceDrawer, ...]:
        return (self._opaque,) if self._see_through is None else (self._opaque, self._see_through)

    def _draw_sky(self, view: View) -> None:
        half = math.tan(math.radians(view.field_of_view) / 2)
        right, up, back = view.rotation.T
        rays = np.stack([right * half * view.width / view.height, up * half, -back])
        _write(self._sky, "u_rays", rays.astype(np.float32).tobytes())  # one column of the matrix after the other
        self._sky_array.render(moderngl.TRIANGLES, vertices=3)


def _write(program: moderngl.Program, uniform: str, data: bytes) -> None:
    member: Any = program[uniform]
    member.write(data)
