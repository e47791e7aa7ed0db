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
from jobs.importing.reading.texture_alpha import Wrap
from jobs.importing.reading.vertex_colours import Texture, tint, to_colours

_TEXTURE = re.compile(rb"^\s*(?:map_\w+|bump|disp|decal|norm|refl)\s+(.+?)\s*$", re.MULTILINE)


@dataclass(frozen=True, eq=False)
class Map:
    """An image, and how texture coordinates lie in it."""

    image: Texture
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
    texture: Map | None
    opacity: Map | None  # by its image's alpha
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
            sampled = self.texture.image.sample(
                self.texture.places(coordinates), triangles[which], (self.texture.wrap, self.texture.wrap)
            )
            colours[where, :3] = tint(sampled[where, :3], colours[where, :3])
        if self.opacity is not None:
            wrap = (self.opacity.wrap, self.opacity.wrap)
            whole = which & where[triangles].all(axis=1)
            alphas.take(whole, self.opacity.image.alpha, self.opacity.places(coordinates), triangles, wrap)


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
        self._opacities: dict[tuple[str, str], Texture] = {}

    def image(self, name: str) -> Texture | None:
        if name not in self._images:
            self._images[name] = Texture.decode(self._resources.read(name))
        return self._images[name]

    def opacity(self, name: str, image: Texture, channel: str) -> Texture:
        """The same image with one of its channels as alpha."""
        key = (name, channel)
        if key not in self._opacities:
            pixels = image.pixels.copy()
            pixels[..., 3] = _channel(image.pixels, channel)
            self._opacities[key] = Texture(pixels)
        return self._opacities[key]


def _channel(pixels: np.ndarray, channel: str) -> np.ndarray:
    """One channel (h, w) uint8 of an image (h, w, 4) by its letter in MTL: red, green, blue, matte, luminance."""
    if channel in ("r", "g", "b"):
        return pixels[..., "rgb".index(channel)]
    if channel == "m" or (channel != "l" and (pixels[..., 3] < 255).any()):
        return pixels[..., 3]
    shares = pixels[..., :3].astype(np.float32) * np.float32([0.2126, 0.7152, 0.0722])
    return np.rint((shares[..., 0] + shares[..., 1]) + shares[..., 2]).astype(np.uint8)


def _material(entries: dict[str, bytes], textures: _Textures) -> Material:
    colour = floats_of(entries.get("kd", b"1 1 1" if "map_kd" in entries else b"0.8 0.8 0.8"))
    if len(colour) == 1:
        colour = np.repeat(colour, 3)
    colour = colour[:3] if len(colour) >= 3 else np.full(3, 0.8)
    bad = ~np.isfinite(colour)
    rgba = to_colours(np.append(np.where(bad, 0.8, colour), _opacity(entries))[None])[0]
    maps: dict[str, Map | None] = {"map_kd": None, "map_d": None}
    missing = 0
    for key in maps:
        if key not in entries:
            continue
        wanted = _statement(entries[key])
        image = textures.image(wanted.name)
        missing += image is None
        if image is not None:
            image = image if key == "map_kd" else textures.opacity(wanted.name, image, wanted.channel)
            maps[key] = Map(image, wanted.scale, wanted.offset, wanted.wrap)
    return Material(rgba, maps["map_kd"], maps["map_d"] or maps["map_kd"], missing, int(bad.any()))


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
    scale: tuple[float, float]
    offset: tuple[float, float]
    wrap: Wrap
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
    return _Statement(name, (u, v), (x, y), wrap, singles[b"-imfchan"].decode("latin-1"))
