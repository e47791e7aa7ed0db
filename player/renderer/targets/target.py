"""The picture that is drawn into: colour with coverage in alpha, and depth; read back or shown in a window.

Covered is what an opaque surface covers: what can be seen through changes colours alone.
"""

from __future__ import annotations

import math

import moderngl
import numpy as np
from numpy.typing import NDArray

from player.camera.view import View
from player.renderer.context import depth_buffer
from player.renderer.targets.layers import Layers


class Target:
    """A framebuffer of `size` pixels, with `samples` per pixel (0: one, no multisampling)."""

    def __init__(
        self,
        context: moderngl.Context,
        size: tuple[int, int],
        *,
        samples: int,
        reversed_depth: bool,
        see_through: bool = False,
    ) -> None:
        """see_through: it has layers for what can be seen through; without them, that is drawn like all else."""
        self.size = size
        self._context = context
        self._colour: moderngl.Texture | moderngl.Renderbuffer
        self._depth = depth_buffer(context, size, samples=samples, reversed_depth=reversed_depth)
        self.layers: Layers | None = None
        if see_through:
            self._colour = context.texture(size, 4, samples=samples)
            self.layers = Layers(context, self._colour, self._depth, samples=samples)
        else:
            self._colour = context.renderbuffer(size, 4, samples=samples)
        self.framebuffer = context.framebuffer([self._colour], self._depth)
        self._resolved_colour = context.renderbuffer(size, 4) if samples or see_through else self._colour
        self.resolved = context.framebuffer([self._resolved_colour])  # without depth: that cannot be copied to a window

    def resolve(self) -> None:
        """Makes `resolved` hold what `framebuffer` holds."""
        if self._resolved_colour is not self._colour:
            self._context.copy_framebuffer(self.resolved, self.framebuffer)

    def read(self) -> NDArray[np.uint8]:
        """The picture (height, width, 4), first row on top; alpha is 255 where opaque surfaces are, 0 elsewhere."""
        data = self.resolved.read(components=4, alignment=1)
        return np.frombuffer(data, np.uint8).reshape(self.size[1], self.size[0], 4)[::-1].copy()

    def nearest(self, view: View, reversed_depth: bool) -> float:
        """Distance along the line of sight, in model units, of the nearest surface drawn; infinite if there is none."""
        depth = np.frombuffer(self.framebuffer.read(components=1, attachment=-1, dtype="f4"), np.float32)
        if reversed_depth:
            closest = float(depth.max())
            return view.near / closest if closest > 0 else math.inf
        closest = float(depth.min())
        if closest >= 1:
            return math.inf
        return 2 * view.far * view.near / (view.far + view.near - (2 * closest - 1) * (view.far - view.near))

    def release(self) -> None:
        """Frees the buffers."""
        self._context.detect_framebuffer(0).use()  # a framebuffer that is bound must not be deleted
        if self.layers is not None:
            self.layers.release()
        self.resolved.release()
        self.framebuffer.release()
        if self._resolved_colour is not self._colour:
            self._resolved_colour.release()
        self._colour.release()
        self._depth.release()
