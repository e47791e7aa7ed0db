"""The picture that is drawn into: colour with coverage in alpha, and depth; read back or shown in a window."""

from __future__ import annotations

import moderngl
import numpy as np
from numpy.typing import NDArray

from player.renderer.context import depth_buffer


class Target:
    """A framebuffer of `size` pixels, with `samples` per pixel (0: one, no multisampling)."""

    def __init__(
        self, context: moderngl.Context, size: tuple[int, int], *, samples: int, reversed_depth: bool
    ) -> None:
        self.size = size
        self._context = context
        self._colour = context.renderbuffer(size, 4, samples=samples)
        self._depth = depth_buffer(context, size, samples=samples, reversed_depth=reversed_depth)
        self.framebuffer = context.framebuffer([self._colour], self._depth)
        self._resolved_colour: moderngl.Renderbuffer | None = None
        self.resolved = self.framebuffer
        if samples:
            self._resolved_colour = context.renderbuffer(size, 4)
            self.resolved = context.framebuffer([self._resolved_colour])

    def resolve(self) -> None:
        """Makes `resolved` hold the finished picture."""
        if self.resolved is not self.framebuffer:
            self._context.copy_framebuffer(self.resolved, self.framebuffer)

    def read(self) -> NDArray[np.uint8]:
        """The picture (height, width, 4), first row on top; alpha is 255 where a surface was drawn, 0 where none was."""
        data = self.resolved.read(components=4, alignment=1)
        return np.frombuffer(data, np.uint8).reshape(self.size[1], self.size[0], 4)[::-1].copy()

    def release(self) -> None:
        """Frees the buffers."""
        if self._resolved_colour is not None:
            self.resolved.release()
            self._resolved_colour.release()
        self.framebuffer.release()
        self._colour.release()
        self._depth.release()
