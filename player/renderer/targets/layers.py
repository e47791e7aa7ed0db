"""What can be seen through: summed up in whatever order it is drawn, then laid over the opaque picture.

Based on: M. McGuire and L. Bavoil: Weighted Blended Order-Independent Transparency, Journal of Computer Graphics
Techniques 2(2), 2013. Each surface adds its colour, weighted by its alpha and by how near it is; what all of them let
through together is a product, which knows no order. One surface, and several of one colour, come out exactly. Where
several colours lie one behind the other, what is behind them all is dimmed exactly, and the mixture is of their colours
alone, but how much of each is a guess from alpha and distance.

Why not depth peeling, which is exact: it draws everything once for every surface along a line of sight, so that what a
frame takes has no bound in a building of glass; and with several samples a pixel it must compare depths sample by
sample, for which OpenGL 3.3 has no shader. Sums take one pass whatever lies behind what, and the depth test of the
opaque picture, sample by sample.

The weight of a distance is its inverse. As a power it makes no difference between a model in metres and one in
millimetres: a common factor of all weights falls out of the mixture. A higher power would let a nearly clear pane close
to the eye take all colour from what lies behind it. It is the distance, not the depth along the line of sight: turning
the head changes no colour. Sums are 32-bit floating point, so that their order shows in no pixel; and light is mixed,
not its sRGB values.
"""

from __future__ import annotations

from typing import Any

import moderngl

from player.renderer import shaders


class Layers:
    """Sums over all that can be seen through, in textures as large and with as many samples as the opaque picture.

    Red, green and blue add up, alpha multiplies: then both textures do with the one blend function that OpenGL 3.3 has.
    """

    def __init__(
        self, context: moderngl.Context, opaque: moderngl.Texture, depth: moderngl.Renderbuffer, *, samples: int
    ) -> None:
        """opaque: colours of the opaque picture; depth: its depth, against which surfaces are tested."""
        self._context = context
        self.opaque = opaque
        self.samples = samples
        self.sums = context.texture(opaque.size, 4, samples=samples, dtype="f4")  # colours; what is let through
        self.weights = context.texture(opaque.size, 1, samples=samples, dtype="f4")
        self._framebuffer = context.framebuffer([self.sums, self.weights], depth)
        self._framebuffer.depth_mask = False

    def begin(self) -> None:
        """Empties the sums; what is drawn from now on, until `end`, is added."""
        self._framebuffer.use()
        self._framebuffer.clear(0.0, 0.0, 0.0, 1.0)
        _blend(self._context, moderngl.ONE, moderngl.ONE, moderngl.ZERO, moderngl.ONE_MINUS_SRC_ALPHA)

    def end(self) -> None:
        """Nothing is added any more."""
        self._context.disable(moderngl.BLEND)

    def release(self) -> None:
        """Frees what it holds on the GPU."""
        for item in (self._framebuffer, self.sums, self.weights):
            item.release()


class Overlay:
    """Lays layers over the opaque picture below them."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._known: dict[int, tuple[moderngl.Program, moderngl.VertexArray]] = {}  # by samples

    def draw(self, layers: Layers, resolved: moderngl.Framebuffer) -> None:
        """Draws into `resolved`, which holds the opaque picture, one sample a pixel; its alpha stays as it is.

        Each sample is mixed for itself, so that edges of opaque surfaces before a pane have no fringe.
        """
        program, array = self._of(layers.samples)
        for unit, (name, texture) in enumerate(
            (("u_opaque", layers.opaque), ("u_sums", layers.sums), ("u_weights", layers.weights))
        ):
            program[name] = unit
            texture.use(unit)
        resolved.use()
        self._context.disable(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        _blend(self._context, moderngl.ONE, moderngl.ZERO, moderngl.ZERO, moderngl.ONE)
        array.render(moderngl.TRIANGLES, vertices=3)
        self._context.disable(moderngl.BLEND)

    def release(self) -> None:
        """Frees what it holds on the GPU."""
        for program, array in self._known.values():
            array.release()
            program.release()
        self._known.clear()

    def _of(self, samples: int) -> tuple[moderngl.Program, moderngl.VertexArray]:
        if samples not in self._known:
            vertex, fragment = shaders.overlay(samples)
            program = self._context.program(vertex_shader=vertex, fragment_shader=fragment)
            self._known[samples] = program, self._context.vertex_array(program, [])
        return self._known[samples]


def _blend(context: moderngl.Context, *factors: int) -> None:
    """Blends from now on, in all textures: factors of the new and the old colours, of the new and the old alpha."""
    function: Any = factors  # moderngl's types know no factors apart
    context.enable(moderngl.BLEND)
    context.blend_func = function
