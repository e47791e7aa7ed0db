"""One frame after the other: choose, load, draw, count. Shared by the window and by rendering without one."""

from __future__ import annotations

import time
from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from player import colouring, strategies
from player.camera.view import Vector, View, looking
from player.loading.packs import Packs, packs_of
from player.loading.stand_ins import stand_ins
from player.offers import named
from player.renderer.context import Abilities
from player.renderer.draw_list import draw_tables
from player.renderer.renderer import Renderer, Style
from player.renderer.targets.target import Target
from player.shown_model import ShownModel
from player.strategies.strategy import Strategy
from storage.model.cut import cut_within

#: The part of the cache that a coarse picture of the whole model may take, so that there is always something to draw.
_BASE_SHARE = 0.25
#: Its error begins at the model's extent, and is halved at most so often.
_BASE_STEPS = 12


@dataclass(frozen=True)
class Settings:
    """How to walk through a store."""

    strategy: str = strategies.STRATEGIES[0].name
    pixel_error: float | None = None  # in pixels of the screen that the store was built for; None: as it was built
    cache_bytes: int = 1 << 30  # budget of vertices and indices on the GPU
    threads: int = 4  # that load geometry
    wait: bool = True  # frames wait for their geometry; otherwise other levels stand in until it has arrived
    prefetch: bool = True
    fog: float = 0.0  # fading into the distance, per model unit
    sky: bool = True
    colours: str = colouring.COLOURINGS[0].name


@dataclass(frozen=True)
class FrameStatistics:
    """What one frame took."""

    strategy: str
    cell: int  # the view cell that holds the eye, -1 outside the computed ones
    computed: bool  # drawn from the cell's vLOD; False: by culling at run time, or everything
    approximate: bool  # the vLOD is for another pixel error than the store was built for: something may lack
    drawables: int
    triangles: int
    turned_triangles: int  # of these drawables, left out because the cell can only see their backs
    draw_calls: int
    replaced: int  # nodes drawn at another level or by one above them, because the chosen level had not arrived
    absent: int  # nodes not drawn, because nothing of them or above them had arrived
    unreadable: int  # packs and lists needed now that cannot be had, part of `replaced` and `absent`
    trouble: str  # why one of them could not, or what damage was met while loading ahead; empty: all is well
    bytes_fetched: int  # from the store since it was opened
    cache_bytes: int  # vertices and indices on the GPU
    strategy_ms: float  # choosing the drawables
    cpu_ms: float  # choosing the drawables and preparing the draw commands
    wait_ms: float  # for geometry to arrive and to be uploaded
    draw_ms: float  # in OpenGL, from the first command until the picture is finished
    frame_ms: float  # from the beginning until the picture is finished


class Walkthrough:
    """A store, a strategy and a renderer at work together in one context."""

    def __init__(self, model: ShownModel, context: moderngl.Context, able: Abilities, settings: Settings) -> None:
        self.model = model
        self.settings = settings
        self.frozen: View | None = None  # choose the drawables for this view, whatever view is drawn
        store = model.store
        self.renderer = Renderer(
            context,
            able,
            draw_tables(store.drawables, store.geometry, store.instances, store.grid.step),
            len(store.packs),
            store.instances["matrix"],
            store.grid.step,
            Style(up=store.manifest.model.up, fog=settings.fog, sky=settings.sky),
        )
        arena, facets = self.renderer.arena, self.renderer.facets
        self.packs = Packs(store, arena, facets, budget=settings.cache_bytes, threads=settings.threads)
        self._context = context
        self._pack_of = packs_of(store)
        self.strategy_name = settings.strategy
        self._strategy = self._make_strategy(settings.strategy)
        self.colours = colouring.COLOURINGS[0].name
        self.use_colours(settings.colours)
        self._last_position: np.ndarray | None = None
        if not settings.wait:
            self._load_base()

    @property
    def strategy(self) -> Strategy:
        """The strategy in use."""
        return self._strategy

    def use_strategy(self, name: str) -> None:
        """Changes the strategy; what is on the GPU stays. Raises ParameterError if there is none of that name."""
        if name != self.strategy_name:
            made = self._make_strategy(name, self._strategy.pixel_error)
            self._strategy.close()
            self._strategy, self.strategy_name = made, name

    def use_colours(self, name: str) -> None:
        """Changes what the colours show. Raises ParameterError if there are none of that name."""
        if name != self.colours:
            tints = named(colouring.COLOURINGS, name, "colouring").load()
            self.renderer.paint(tints(self.model.store.nodes, self.model.store.drawables))
            self.colours = name

    def frame(self, view: View, target: Target) -> FrameStatistics:
        """Draws `view` into `target`."""
        started = time.perf_counter()
        choice = self._strategy.choose(self.frozen or view)
        chosen = time.perf_counter()
        packs = self._in_order(choice.drawables)
        self.packs.need(packs, wait=self.settings.wait)
        loaded = time.perf_counter()
        drawn = stand_ins(choice.drawables, self.model, self._ready)
        draws = self.renderer.prepare(drawn.drawables, choice.within)
        prepared = time.perf_counter()
        calls = self.renderer.draw(view, draws, target)
        self._context.finish()
        finished = time.perf_counter()
        troubles = [*([choice.missing] if choice.missing else []), *self.packs.failures(packs)]
        if self.settings.prefetch:
            self._prefetch(view)
        return FrameStatistics(
            strategy=self.strategy_name,
            cell=choice.cell,
            computed=choice.computed,
            approximate=choice.approximate,
            drawables=draws.drawables,
            triangles=draws.triangles,
            turned_triangles=draws.turned,
            draw_calls=calls,
            replaced=drawn.replaced,
            absent=drawn.absent,
            unreadable=len(troubles),
            trouble=str(troubles[0] if troubles else self.packs.damage or ""),
            bytes_fetched=self.model.store.bytes_fetched,
            cache_bytes=self.packs.cache.bytes,
            strategy_ms=1000 * (chosen - started),
            cpu_ms=1000 * (chosen - started + prepared - loaded),
            wait_ms=1000 * (loaded - chosen),
            draw_ms=1000 * (finished - prepared),
            frame_ms=1000 * (finished - started),
        )

    def distance(self, position: Vector, direction: Vector, up: Vector, probe: Target) -> float:
        """Distance in model units from `position` (3,) to the nearest surface drawn along a unit direction (3,).

        What can be seen through is as solid as all else.

        Looks through a lens of 20 degrees at what the strategy would draw; infinite where there is nothing. up: any
        direction (3,) across it; probe: a small target to draw into, without layers.
        """
        near = max(1e-5 * self.model.extent, 2 * self.model.store.grid.step)
        width, height = probe.size
        view = View(position, looking(direction, up), 20.0, width, height, near, 4 * self.model.extent)
        choice = self._strategy.choose(view)
        ids = choice.drawables[self._ready(choice.drawables)]
        self.renderer.draw(view, self.renderer.prepare(ids, choice.within), probe)
        return probe.nearest(view, self.renderer.able.reversed_depth)

    def close(self) -> None:
        """Stops the threads and frees the GPU."""
        self._strategy.close()
        self.packs.close()
        self.renderer.release()

    def _make_strategy(self, name: str, pixel_error: float | None = None) -> Strategy:
        make = named(strategies.STRATEGIES, name, "strategy").load()
        error = pixel_error or self.settings.pixel_error or self.model.pixel_error
        return make(self.model, pixel_error=error, wait=self.settings.wait)

    def _ready(self, ids: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which of the drawables (n,) are on the GPU."""
        return self.packs.cache.resident[self._pack_of[ids]]

    def _in_order(self, ids: NDArray[np.int64]) -> NDArray[np.int64]:
        """The packs (k,) of drawables (n,), each once, in the order of their first."""
        packs, first = np.unique(self._pack_of[ids], return_index=True)
        return packs[np.argsort(first)]

    def _prefetch(self, view: View) -> None:
        last = self._last_position
        motion = np.zeros(3) if last is None else view.position - last
        self._last_position = view.position
        ahead = self._strategy.ahead(view, motion)
        if ahead is not None:
            self.packs.prefetch(self._in_order(ahead))
        if self.settings.wait:
            self.packs.settle()

    def _load_base(self) -> None:
        """Keeps the finest picture of the whole model that takes no more than its share of the cache."""
        store, error = self.model.store, self.model.extent
        kept: NDArray[np.int64] | None = None
        for _ in range(_BASE_STEPS):
            cut = cut_within(store.nodes, store.drawables, error)
            packs = np.unique(self._pack_of[cut])
            if self.packs.bytes_of(packs) > _BASE_SHARE * self.settings.cache_bytes:
                break
            kept, error = packs, error / 2
        if kept is not None:
            self.packs.keep(kept)
