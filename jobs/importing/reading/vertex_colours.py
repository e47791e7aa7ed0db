"""Materials and textures become vertex colours.

A texture is sampled at every vertex's texture coordinates, a little inside the faces around it and averaged over about
an eighth of their size: a vertex on the border of an image, or on a grain of a fine pattern, still gets the colour that
its faces show.
"""

from __future__ import annotations

import io
import warnings
from functools import cached_property

import numpy as np

from jobs.importing.reading.texture_alpha import TextureAlpha, Wrap

#: What is drawn where a file names no colour: opaque light grey.
DEFAULT_COLOUR = (204, 204, 204, 255)

#: How far samples move from a vertex towards the middle of its faces, as a share of the way.
_INSIDE = 1 / 16

#: Share of a face's width that one sample is averaged over.
_FOOTPRINT = 1 / 8

#: What is read as an image; Pillow's other formats have no business in a model (some start other programs).
_IMAGES = ("PNG", "JPEG", "WEBP", "BMP", "TGA", "TIFF", "GIF", "DDS", "PPM")

_DECODE = np.array([v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in (i / 255 for i in range(256))])

#: Linear values halfway between neighbouring 8-bit sRGB values, rounded so that they are the same on every machine.
_BETWEEN = np.array(
    [
        round(v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4, 12)
        for v in ((i + 0.5) / 255 for i in range(255))
    ]
)


def srgb_to_linear(values: np.ndarray) -> np.ndarray:
    """Linear light, 0 to 1, of 8-bit sRGB values."""
    return _DECODE[values]


def linear_to_srgb(values: np.ndarray) -> np.ndarray:
    """8-bit sRGB values of linear light, 0 to 1."""
    return np.searchsorted(_BETWEEN, values).astype(np.uint8)


def to_bytes(values: np.ndarray) -> np.ndarray:
    """8-bit values of numbers from 0 to 1; what lies outside is clipped, NaN becomes 0."""
    return np.rint(np.clip(np.nan_to_num(np.asarray(values, np.float64), nan=0.0), 0, 1) * 255).astype(np.uint8)


def from_linear(values: np.ndarray) -> np.ndarray:
    """SRGB colours and alpha (n, 4) uint8 of linear colours (n, 3 or 4), 0 to 1."""
    values = np.clip(np.nan_to_num(np.asarray(values, np.float64), nan=0.0), 0, 1)
    colours = np.full((len(values), 4), 255, np.uint8)
    colours[:, :3] = linear_to_srgb(values[:, :3])
    if values.shape[1] > 3:
        colours[:, 3] = to_bytes(values[:, 3])
    return colours


def to_colours(values: np.ndarray) -> np.ndarray:
    """Colours and alpha (n, 4) uint8 of sRGB colours (n, 3 or 4), 0 to 1."""
    colours = np.full((len(values), 4), 255, np.uint8)
    colours[:, : values.shape[1]] = to_bytes(values)
    return colours


class Texture:
    """An image to be sampled. Row 0 is its top."""

    def __init__(self, pixels: np.ndarray) -> None:
        """`pixels`: (h, w, 4) uint8 sRGB and alpha."""
        self.pixels = pixels

    @staticmethod
    def decode(data: bytes | None) -> Texture | None:
        """The image in the bytes of a PNG, JPEG or other image file; None if there is none or it is damaged."""
        from PIL import Image

        if not data:
            return None
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                warnings.simplefilter("error", Image.DecompressionBombWarning)
                with Image.open(io.BytesIO(data), formats=_IMAGES) as image:
                    pixels = np.array(image.convert("RGBA"), np.uint8)
        except Exception:  # Pillow raises almost anything on damaged files
            return None
        return Texture(pixels) if pixels.size else None

    @cached_property
    def alpha(self) -> TextureAlpha:
        """The image's alpha, to be asked for whole triangles."""
        return TextureAlpha(self.pixels[..., 3])

    @cached_property
    def red(self) -> TextureAlpha:
        """The image's red channel, to be asked in the same way."""
        return TextureAlpha(self.pixels[..., 0])

    @cached_property
    def opaque(self) -> Texture:
        """The same image without its alpha: what lies where it cannot be seen has its own colour too."""
        if self.alpha.opaque:
            return self
        pixels = self.pixels.copy()
        pixels[..., 3] = 255
        return Texture(pixels)

    @property
    def held(self) -> int:
        """Bytes that the image may take with all that is made of it, an upper estimate."""
        return self.pixels.nbytes * (2 if self.alpha.opaque else 4)

    @cached_property
    def _levels(self) -> list[np.ndarray]:
        """The image and its halvings, colours weighted by alpha."""
        levels = [self.pixels]
        current = self.pixels.astype(np.float32)
        opaque = self.alpha.opaque  # all weights are 1 then
        if not opaque:
            current[..., :3] *= current[..., 3:] / np.float32(255)
        while max(current.shape[:2]) > 1:
            rows, columns = (max(size // 2, 1) for size in current.shape[:2])
            down = min(current.shape[0], 2)
            right = min(current.shape[1], 2)
            total = np.zeros((rows, columns, 4), np.float32)
            for i in range(down):
                for j in range(right):
                    total += current[i : i + rows * down : down, j : j + columns * right : right]
            total /= np.float32(down * right)
            current = total
            if opaque:
                levels.append(np.rint(current).astype(np.uint8))
                continue
            alpha = np.maximum(current[..., 3:] / np.float32(255), np.float32(1e-6))
            plain = current.copy()
            plain[..., :3] /= alpha
            np.minimum(plain, 255, out=plain)
            levels.append(np.rint(plain, out=plain).astype(np.uint8))
        return levels

    def sample(
        self, places: np.ndarray, triangles: np.ndarray, wrap: tuple[Wrap, Wrap] = (Wrap.REPEAT, Wrap.REPEAT)
    ) -> np.ndarray:
        """Colours (n, 4) uint8 at texture coordinates `places` (n, 2): (0, 0) is the image's top left corner, (1, 1)
        its bottom right; `wrap` is how it goes on across and down. `triangles` (m, 3) index `places`.
        """
        places = np.nan_to_num(np.asarray(places, np.float64), nan=0.0, posinf=0.0, neginf=0.0)
        size = np.array([self.pixels.shape[1], self.pixels.shape[0]], np.float64)
        corners = places[triangles]
        middles = corners.mean(axis=1)
        widths = ((corners.max(axis=1) - corners.min(axis=1)) * size).max(axis=1)
        flat = triangles.reshape(-1)
        users = np.bincount(flat, minlength=len(places))
        middle = np.stack(
            [np.bincount(flat, np.repeat(middles[:, axis], 3), minlength=len(places)) for axis in range(2)], axis=1
        )
        width = np.bincount(flat, np.repeat(widths, 3), minlength=len(places)) / np.maximum(users, 1)
        inside = places + (middle / np.maximum(users, 1)[:, None] - places) * (_INSIDE * (users > 0))[:, None]
        for axis in range(2):
            inside[:, axis] = _wrapped(inside[:, axis], wrap[axis])
        level = np.clip(np.frexp(np.maximum(width * _FOOTPRINT, 1.0))[1] - 1, 0, len(self._levels) - 1)
        colours = np.zeros((len(places), 4), np.uint8)
        for number in np.unique(level):
            at = np.flatnonzero(level == number)
            image = self._levels[number]
            column = np.minimum((inside[at, 0] * image.shape[1]).astype(np.int64), image.shape[1] - 1)
            row = np.minimum((inside[at, 1] * image.shape[0]).astype(np.int64), image.shape[0] - 1)
            colours[at] = image[row, column]
        return colours


def _wrapped(places: np.ndarray, wrap: Wrap) -> np.ndarray:
    """Texture coordinates (n,) of one axis where the image itself shows the same, 0 to 1."""
    if wrap is Wrap.CLAMP:
        return np.clip(places, 0.0, 1.0)
    if wrap is Wrap.MIRROR:
        return 1.0 - np.abs(places - 2.0 * np.floor(places / 2.0) - 1.0)
    return places - np.floor(places)


def tint(sampled: np.ndarray, colour: np.ndarray) -> np.ndarray:
    """Colours (n, 4) uint8 times a colour (4,) or (n, 4) uint8, as sRGB values: for formats that know no linear
    light.
    """
    return np.rint(sampled.astype(np.float64) * np.asarray(colour, np.float64) / 255).astype(np.uint8)
