"""Material libraries of OBJ files (.mtl): colours, opacity and textures.

Opacity is `d`, or 1 - `Tr` where there is no `d` (writers that write both mean `d`; some mean opacity by a `Tr` of 1
alone, and nobody exports what cannot be seen at all), times `map_d`: its channel of `-imfchan`, else its alpha if it
has one, else its luminance. Where there is no `map_d` the alpha of `map_Kd` counts.

Based on: the Wavefront Material Template Library format (MTL), Alias/Wavefront Advanced Visualizer 4, file formats.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from jobs.importing.reading.blended import Alphas
from jobs.importing.reading.defects import Defect, Tally
from jobs.importing.reading.resources import Resources
from jobs.importing.reading.text.numbers import floats_of
from jobs.importing.reading.text.words import name_of, reference_of, without_mark
from jobs.importing.reading.texture_alpha import TextureAlpha, Wrap
from jobs.importing.reading.vertex_colours import Texture, tint, to_colours

_TEXTURE = re.compile(rb"^\s*(?:map_\w+|bump|disp|decal|norm|refl)\s+(.+?)\s*$", re.MULTILINE)


@dataclass(frozen=True, eq=False)
class Map:
    """How texture coordinates lie in an image."""

    scale: tuple[float, float]
    offset: tuple[float, float]
    wrap: Wrap

    def places(self, coordinates: np.ndarray) -> np.ndarray:
        """Where texture coordinates (n, 2) lie in the image, from its top left corner."""
        places = coordinates * self.scale + self.offset
        places[:, 1] = 1 - places[:, 1]
        return places


@dataclass(frozen=True, eq=False)
class Material:
    """What a material library says of one material."""

    colour: np.ndarray  # (4,) uint8
    texture: tuple[Texture, Map] | None
    opacity: tuple[TextureAlpha, Map] | None
    missing: int  # textures that are not there
    not_finite: int

    @property
    def textured(self) -> bool:
        """Whether texture coordinates make a difference."""
        return self.texture is not None or self.opacity is not None

    def apply(
        self,
        colours: np.ndarray,
        alphas: Alphas,
        where: np.ndarray,
        coordinates: np.ndarray,
        which: np.ndarray,
        triangles: np.ndarray,
    ) -> None:
        """Tint `colours` (n, 4) at `where` (n,) by the textures at texture coordinates (n, 2), and give the triangles
        `which` (m,) bool of `triangles` (m, 3) their alpha.
        """
        if self.texture is not None:
            image, laid = self.texture
            sampled = image.sample(laid.places(coordinates), triangles[which], (laid.wrap, laid.wrap))
            colours[where, :3] = tint(sampled[where, :3], colours[where, :3])
        if self.opacity is not None:
            alpha, laid = self.opacity
            whole = which & where[triangles].all(axis=1)
            alphas.take(whole, alpha, laid.places(coordinates), triangles, (laid.wrap, laid.wrap))


def named_textures(library: bytes) -> Iterator[str]:
    """The textures that a material library names, of any kind: whole statements, and their last words."""
    for match in _TEXTURE.finditer(library):
        text = reference_of(match[1])
        yield text
        yield text.split()[-1]


def read_materials(
    libraries: list[str], resources: Resources, tally: Tally, file_name: str
) -> tuple[dict[str, Material], bool]:
    """All materials of some libraries, and whether there are any libraries and all of them were found.

    Missing ones are counted in `tally` under `file_name`.
    """
    materials: dict[str, Material] = {}
    textures = _Textures(resources)
    complete = bool(libraries)
    for names in dict.fromkeys(libraries):
        found = [resources.read(names)]
        if found[0] is None and len(names.split()) > 1:
            found = [resources.read(name) for name in names.split()]
        for data in found:
            if data is None:
                tally.add(Defect.NO_LIBRARY, file_name)
                complete = False
            else:
                for name, entries in _library(data).items():
                    materials.setdefault(name, _material(entries, textures))
    return materials, complete


def material_named(materials: Mapping[str, Material], name: str) -> Material | None:
    """The material of a name, or the only one whose name differs in capital and small letters alone."""
    if name in materials or not name:
        return materials.get(name)
    same = [other for other in materials if other.casefold() == name.casefold()]
    return materials[same[0]] if len(same) == 1 else None


def _library(data: bytes) -> dict[str, dict[str, bytes]]:
    """A material library's entries by material and keyword (lower case)."""
    materials: dict[str, dict[str, bytes]] = {}
    current: dict[str, bytes] = {}
    lines = without_mark(data).replace(b"\r\n", b"\n").replace(b"\r", b"\n").replace(b"\\\n", b" ")
    for line in lines.split(b"\n"):
        words = line.strip().split(None, 1)
        if len(words) == 2:
            key, rest = words[0].lower(), words[1].strip()
            if key == b"newmtl":
                current = materials.setdefault(name_of(rest), {})
            else:
                current[key.decode("latin-1")] = rest
    return materials


class _Textures:
    """The images that material libraries name, each read once."""

    def __init__(self, resources: Resources) -> None:
        self._resources = resources
        self._images: dict[str, Texture | None] = {}
        self._opacities: dict[tuple[str, str], TextureAlpha] = {}

    def image(self, name: str) -> Texture | None:
        if name not in self._images:
            self._images[name] = Texture.decode(self._resources.read(name))
        return self._images[name]

    def opacity(self, name: str, image: Texture, channel: str) -> TextureAlpha:
        """One of an image's channels as alpha."""
        key = (name, channel)
        if key not in self._opacities:
            self._opacities[key] = _channel(image, channel)
        return self._opacities[key]


def _channel(image: Texture, channel: str) -> TextureAlpha:
    """One channel of an image by its letter in MTL: red, green, blue, matte, luminance."""
    if channel in ("r", "g", "b"):
        return TextureAlpha(image.pixels[..., "rgb".index(channel)])
    if channel == "m" or (channel != "l" and not image.alpha.opaque):
        return image.alpha
    red, green, blue = (image.pixels[..., k].astype(np.uint32) for k in range(3))
    return TextureAlpha(((54 * red + 183 * green + 19 * blue + 128) >> 8).astype(np.uint8))


def _material(entries: dict[str, bytes], textures: _Textures) -> Material:
    colour = floats_of(entries.get("kd", b"1 1 1" if "map_kd" in entries else b"0.8 0.8 0.8"))
    if len(colour) == 1:
        colour = np.repeat(colour, 3)
    colour = colour[:3] if len(colour) >= 3 else np.full(3, 0.8)
    bad = ~np.isfinite(colour)
    rgba = to_colours(np.append(np.where(bad, 0.8, colour), _opacity(entries))[None])[0]
    texture: tuple[Texture, Map] | None = None
    opacity: tuple[TextureAlpha, Map] | None = None
    missing = 0
    if "map_kd" in entries:
        wanted = _statement(entries["map_kd"])
        image = textures.image(wanted.name)
        missing += image is None
        texture = None if image is None else (image, wanted.laid)
    if "map_d" in entries:
        wanted = _statement(entries["map_d"])
        image = textures.image(wanted.name)
        missing += image is None
        opacity = None if image is None else (textures.opacity(wanted.name, image, wanted.channel), wanted.laid)
    if opacity is None and texture is not None:
        opacity = (texture[0].alpha, texture[1])
    return Material(rgba, texture, opacity, missing, int(bad.any()))


def _opacity(entries: dict[str, bytes]) -> float:
    """Opacity, 0 to 1."""
    if "d" in entries:
        values = floats_of(entries["d"].replace(b"-halo", b""))
    else:
        values = 1 - floats_of(entries.get("tr", b"0"))
        if len(values) and values[0] == 0:
            values = np.ones(1)
    return min(max(float(values[0]), 0.0), 1.0) if len(values) and np.isfinite(values[0]) else 1.0


@dataclass(frozen=True)
class _Statement:
    """What a texture statement says."""

    name: str
    laid: Map
    channel: str  # of -imfchan, "" if it does not say


def _statement(text: bytes) -> _Statement:
    """A texture statement: options that make no difference are passed over."""
    words = text.split()
    vectors = {b"-s": [1.0, 1.0, 1.0], b"-o": [0.0, 0.0, 0.0], b"-t": [0.0, 0.0, 0.0]}
    singles = {
        b"-blendu": b"",
        b"-blendv": b"",
        b"-cc": b"",
        b"-clamp": b"",
        b"-bm": b"",
        b"-boost": b"",
        b"-imfchan": b"",
        b"-texres": b"",
        b"-type": b"",
    }
    at = 0
    while at < len(words) - 1 and (words[at] in vectors or words[at] in singles or words[at] == b"-mm"):
        option = words[at]
        at += 1
        if option in singles:
            singles[option] = words[at].lower()
            at += 1
        elif option == b"-mm":
            at += 2
        else:
            for axis in range(3):
                value = floats_of(words[at] if at < len(words) - 1 else b"")
                if len(value) != 1 or not np.isfinite(value[0]):
                    break
                vectors[option][axis] = float(value[0])
                at += 1
    name = reference_of(b" ".join(words[at:]) if at else text)
    (u, v), (x, y) = vectors[b"-s"][:2], vectors[b"-o"][:2]
    wrap = Wrap.CLAMP if singles[b"-clamp"] == b"on" else Wrap.REPEAT
    return _Statement(name, Map((u, v), (x, y), wrap), singles[b"-imfchan"].decode("latin-1"))
