"""Draws draw lists: one multi-draw call per batch on OpenGL 4.3, one call per mesh (or run of meshes) on 3.3.

A drawer draws what is opaque, or what can be seen through: each kind has its own shader.
"""

from __future__ import annotations

from typing import Any, Protocol

import moderngl
import numpy as np

from player.renderer import shaders
from player.renderer.arena import Arena
from player.renderer.draw_list import BACK_ONLY, BOTH_SIDES, COMMAND, RECORD, DrawList, merged_runs

_ORDER_WIDTH = 4096  # records in a row of the order texture; the shader knows this number


class SurfaceDrawer(Protocol):
    """One way to draw a draw list."""

    program: moderngl.Program

    def draw(self, draws: DrawList) -> int:
        """Draws everything into the bound framebuffer and returns the number of draw calls."""
        ...

    def release(self) -> None:
        """Frees what it holds on the GPU."""
        ...


def _set_culling(context: moderngl.Context, side: int) -> None:
    if side == BOTH_SIDES:
        context.disable(moderngl.CULL_FACE)
    else:
        context.enable(moderngl.CULL_FACE)
        context.front_face = "ccw"
        context.cull_face = "front" if side == BACK_ONLY else "back"


class _Arrays:
    """The vertex arrays of a program over an arena's slabs; made anew where a slab has got larger buffers."""

    def __init__(self, context: moderngl.Context, program: moderngl.Program, arena: Arena) -> None:
        self._context = context
        self._program = program
        self._arena = arena
        self._known: dict[int, tuple[int, moderngl.VertexArray]] = {}

    def of(self, number: int, *more: tuple[moderngl.Buffer, str, str]) -> moderngl.VertexArray:
        """The array of a slab; more: buffers beside its own, as moderngl takes them, the same until `forget`."""
        slab = self._arena.slabs[number]
        version, array = self._known.get(number, (-1, None))
        if array is None or version != slab.version:
            if array is not None:
                array.release()
            own = (slab.vertex_buffer, "3f4 2i2 4f1", "in_position", "in_normal", "in_colour")
            array = self._context.vertex_array(self._program, [own, *more], slab.index_buffer)
            self._known[number] = (slab.version, array)
        return array

    def forget(self) -> None:
        """Frees all arrays."""
        for _, array in self._known.values():
            array.release()
        self._known.clear()


class MultiDraw:
    """Multi-draw indirect: the commands lie in a buffer, records come as an instanced attribute."""

    def __init__(self, context: moderngl.Context, arena: Arena, *, see_through: bool) -> None:
        """see_through: what it draws goes into the sums of player.renderer.targets.layers; otherwise it is opaque."""
        self._context = context
        vertex, fragment = shaders.surface(multi_draw=True, see_through=see_through)
        self.program = context.program(vertex_shader=vertex, fragment_shader=fragment)
        self._commands = context.buffer(reserve=COMMAND.itemsize << 10, dynamic=True)
        self._records = context.buffer(reserve=RECORD.itemsize << 10, dynamic=True)
        self._arrays = _Arrays(context, self.program, arena)
        self._written: DrawList | None = None

    def draw(self, draws: DrawList) -> int:
        """Draws everything; one call per batch."""
        if draws is not self._written:
            self._commands = self._rewritten(self._commands, draws.commands)
            grown = self._rewritten(self._records, draws.records)
            if grown is not self._records:
                self._records = grown
                self._arrays.forget()
            self._written = draws
        for batch in draws.batches:
            _set_culling(self._context, batch.side)
            array = self._arrays.of(batch.slab, (self._records, "2u4/i", "in_record"))
            array.render_indirect(self._commands, moderngl.TRIANGLES, batch.commands, batch.first)
        return len(draws.batches)

    def release(self) -> None:
        """Frees what it holds on the GPU."""
        self._arrays.forget()
        for item in (self._commands, self._records, self.program):
            item.release()

    def _rewritten(self, buffer: moderngl.Buffer, data: np.ndarray) -> moderngl.Buffer:
        if buffer.size < data.nbytes:
            buffer.release()
            buffer = self._context.buffer(reserve=2 * data.nbytes, dynamic=True)
        else:
            buffer.orphan()
        if data.nbytes:
            buffer.write(data.tobytes())
        return buffer


class SingleDraws:
    """OpenGL 3.3: one call per run of neighbouring meshes of one tint, one per instanced mesh; records in a texture."""

    def __init__(self, context: moderngl.Context, arena: Arena, *, see_through: bool) -> None:
        """see_through: what it draws goes into the sums of player.renderer.targets.layers; otherwise it is opaque."""
        self._context = context
        vertex, fragment = shaders.surface(multi_draw=False, see_through=see_through)
        self.program = context.program(vertex_shader=vertex, fragment_shader=fragment)
        self.program["u_order"] = 1
        self._order = context.texture((_ORDER_WIDTH, 1), 2, dtype="u4")
        self._arrays = _Arrays(context, self.program, arena)
        self._written: DrawList | None = None
        self._calls: list[tuple[int, int, int, int, int, int]] = []

    def draw(self, draws: DrawList) -> int:
        """Draws everything."""
        if draws is not self._written:
            self._write_order(draws.records)
            self._calls = list(draw_calls(draws))
            self._written = draws
        self._order.use(1)
        first_record: Any = self.program["u_first"]
        for slab, side, first, indices, instances, base in self._calls:
            _set_culling(self._context, side)
            first_record.value = base
            self._arrays.of(slab).render(moderngl.TRIANGLES, vertices=indices, first=first, instances=instances)
        return len(self._calls)

    def release(self) -> None:
        """Frees what it holds on the GPU."""
        self._arrays.forget()
        self._order.release()
        self.program.release()

    def _write_order(self, records: np.ndarray) -> None:
        rows = max(1, -(-len(records) // _ORDER_WIDTH))
        if rows > self._order.height:
            self._order.release()
            self._order = self._context.texture((_ORDER_WIDTH, 2 * rows), 2, dtype="u4")
        padded = np.zeros(rows * _ORDER_WIDTH, RECORD)
        padded[: len(records)] = records
        self._order.write(padded.tobytes(), viewport=(0, 0, _ORDER_WIDTH, rows))


def draw_calls(draws: DrawList) -> list[tuple[int, int, int, int, int, int]]:
    """Draw calls of a list: (slab, side, first index, indices, instances, first record)."""
    calls = []
    for batch in draws.batches:
        commands = draws.commands[batch.first : batch.first + batch.commands]
        record = draws.records[commands["base_instance"]]
        baked = (commands["instances"] == 1) & (record["placement"] == 0)
        tint = np.ascontiguousarray(record["tint"]).view(np.uint32)[:, 0]
        changes = np.diff(baked) | (np.diff(tint) != 0)
        for stretch in np.split(np.arange(len(commands)), np.flatnonzero(changes) + 1):
            some = commands[stretch]
            if baked[stretch[0]]:
                base = int(some["base_instance"][0])
                calls += [(batch.slab, batch.side, int(a), int(n), 1, base) for a, n in merged_runs(some)]
            else:
                calls += [
                    (
                        batch.slab,
                        batch.side,
                        int(c["first_index"]),
                        int(c["indices"]),
                        int(c["instances"]),
                        int(c["base_instance"]),
                    )
                    for c in some
                ]
    return calls
