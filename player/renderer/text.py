"""Text over the picture: a small atlas of letters made with Pillow, drawn as textured rectangles."""

from __future__ import annotations

from collections.abc import Sequence

import moderngl
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from player.renderer import shaders

_LETTERS = "".join(chr(code) for code in range(32, 127)) + "·°±…"
_SOLID = "\0"  # a letter that is a filled rectangle: the panel behind the text

Colour = tuple[float, float, float, float]

_TEXT: Colour = (1.0, 1.0, 1.0, 0.95)
_PANEL: Colour = (0.05, 0.07, 0.10, 0.62)


class Atlas:
    """Letters in one grey picture, and where each lies in it."""

    def __init__(self, size: int) -> None:
        """size: of the font, in pixels."""
        font = ImageFont.load_default(size)
        boxes = [font.getbbox(letter) for letter in _LETTERS]
        self.line = int(1.35 * size)
        self.advance = {letter: float(font.getlength(letter)) for letter in _LETTERS}
        self.place: dict[str, tuple[int, int, int, int]] = {}
        cells = [max(int(box[2]) + 2, 2) for box in boxes]
        width = 512
        x, y = 4, 0
        for letter, cell in zip(_LETTERS, cells, strict=True):
            if x + cell > width:
                x, y = 0, y + self.line + 2
            self.place[letter] = (x, y, cell, self.line)
            x += cell + 1
        self.picture = np.zeros((y + self.line + 2, width), np.uint8)
        image = Image.fromarray(self.picture)
        draw = ImageDraw.Draw(image)
        for letter in _LETTERS:
            draw.text(self.place[letter][:2], letter, fill=255, font=font)
        self.picture = np.array(image)
        self.picture[0:3, 0:3] = 255
        self.place[_SOLID] = (1, 1, 1, 1)
        self.advance[_SOLID] = 0.0

    def width(self, text: str) -> float:
        """Width of a line in pixels."""
        return sum(self.advance.get(letter, self.advance["?"]) for letter in text)


class TextOverlay:
    """Draws panels of text into a framebuffer."""

    def __init__(self, context: moderngl.Context, size: int = 15) -> None:
        """size: of the font, in pixels."""
        self.atlas = Atlas(size)
        self._context = context
        self._program = context.program(vertex_shader=shaders.TEXT[0], fragment_shader=shaders.TEXT[1])
        height, width = self.atlas.picture.shape
        self._texture = context.texture((width, height), 1, self.atlas.picture.tobytes(), alignment=1)
        self._buffer = context.buffer(reserve=1 << 18, dynamic=True)
        self._array = context.vertex_array(
            self._program, [(self._buffer, "2f4 2f4 4f4", "in_position", "in_texture", "in_colour")]
        )

    def draw(
        self, rows: Sequence[Sequence[str]], framebuffer: moderngl.Framebuffer, size: tuple[int, int], corner: str
    ) -> None:
        """Draws rows of one or two columns on a panel.

        size: of the framebuffer in pixels; corner: such as "top left" or "bottom right".
        """
        if not rows:
            return
        vertices = layout(self.atlas, rows, size, corner)
        if vertices.nbytes > self._buffer.size:
            vertices = vertices[: self._buffer.size // vertices[0].nbytes // 6 * 6]
        framebuffer.use()
        self._context.viewport = (0, 0, *size)
        self._context.disable(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        self._context.enable(moderngl.BLEND)
        self._context.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA
        self._program["u_size"] = tuple(float(length) for length in size)
        self._texture.use(0)
        self._buffer.orphan()
        self._buffer.write(vertices.tobytes())
        self._array.render(moderngl.TRIANGLES, vertices=len(vertices))
        self._context.disable(moderngl.BLEND)

    def release(self) -> None:
        """Frees what it holds on the GPU."""
        for item in (self._array, self._buffer, self._texture, self._program):
            item.release()


def layout(atlas: Atlas, rows: Sequence[Sequence[str]], size: tuple[int, int], corner: str) -> NDArray[np.float32]:
    """Vertices (n, 8) float32 of a panel: x, y in pixels from the top left, texture x, y, colour; six a rectangle."""
    margin = 10.0
    gap = 14.0
    first = max(atlas.width(row[0]) for row in rows)
    second = max((atlas.width(row[1]) for row in rows if len(row) > 1), default=0.0)
    width = first + (gap + second if second else 0) + 2 * margin
    height = len(rows) * atlas.line + 2 * margin
    left = 12.0 if corner.endswith("left") else size[0] - width - 12.0
    top = 12.0 if corner.startswith("top") else size[1] - height - 12.0
    rectangles = [_rectangle(atlas, _SOLID, left, top, width, height, _PANEL)]
    for number, row in enumerate(rows):
        for column, text in enumerate(row):
            x = left + margin + column * (first + gap)
            y = top + margin + number * atlas.line
            for letter in text:
                shown = letter if letter in atlas.place else "?"
                _, _, wide, high = atlas.place[shown]
                if shown != " ":
                    rectangles.append(_rectangle(atlas, shown, round(x), round(y), wide, high, _TEXT))
                x += atlas.advance[shown]
    return np.concatenate(rectangles)


def _rectangle(
    atlas: Atlas, letter: str, x: float, y: float, width: float, height: float, colour: Colour
) -> NDArray[np.float32]:
    u, v, wide, high = atlas.place[letter]
    rows, columns = atlas.picture.shape
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 0), (1, 1), (0, 1)], np.float32)
    result = np.empty((6, 8), np.float32)
    result[:, :2] = corners * (width, height) + (x, y)
    result[:, 2:4] = (corners * (wide, high) + (u, v)) / (columns, rows)
    result[:, 4:] = colour
    return result
