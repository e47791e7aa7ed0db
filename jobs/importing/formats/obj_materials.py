"""Material libraries of OBJ files (.mtl): colours, opacity and textures."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from jobs.importing.reading.defects import Defect, Tally
from jobs.importing.reading.numbers import floats_of
from jobs.importing.reading.resources import Resources
from jobs.importing.reading.vertex_colours import Texture, tint, to_colours

_TEXTURE = re.compile(rb"^\s*(?:map_\w+|bump|disp|decal|norm|refl)\s+(.+?)\s*$", re.MULTILINE)


@dataclass(frozen=True, eq=False)
class Material:
    """What a material library says of one material."""

    colour: np.ndarray  # (4,) uint8
    texture: Texture | None
    mask: Texture | None  # its brightness is the texture's alpha
    scale: tuple[float, float]
    offset: tuple[float, float]
    missing: int  # textures that are not there
    not_finite: int

    @property
    def textured(self) -> bool:
        """Whether texture coordinates make a difference."""
        return self.texture is not None or self.mask is not None

    def apply(self, colours: np.ndarray, where: np.ndarray, places: np.ndarray, triangles: np.ndarray) -> None:
        """Tint `colours` (n, 4) at `where` (n,) by the textures at `places` (n, 2)."""
        if self.texture is not None:
            colours[where] = tint(self.texture.sample(places, triangles)[where], colours[where])
        if self.mask is not None and (self.texture is None or (self.texture.pixels[..., 3] == 255).all()):
            brightness = self.mask.sample(places, triangles)[where, :3].astype(np.float64).mean(axis=1)
            colours[where, 3] = np.rint(colours[where, 3] * brightness / 255).astype(np.uint8)


def named_textures(library: bytes) -> Iterator[str]:
    """The textures that a material library names, of any kind: whole statements, and their last words."""
    for match in _TEXTURE.finditer(library):
        text = match[1].decode("utf-8", "replace")
        yield text
        yield text.split()[-1]


def read_materials(
    libraries: list[str], resources: Resources, tally: Tally, file_name: str
) -> tuple[dict[str, Material], bool]:
    """All materials of some libraries, and whether there are any libraries and all of them were found.

    Missing ones are counted in `tally` under `file_name`.
    """
    materials: dict[str, Material] = {}
    textures: dict[str, Texture | None] = {}
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
                    materials.setdefault(name, _material(entries, resources, textures))
    return materials, complete


def _library(data: bytes) -> dict[str, dict[str, str]]:
    """A material library's entries by material and keyword (lower case)."""
    materials: dict[str, dict[str, str]] = {}
    current: dict[str, str] = {}
    for line in data.decode("utf-8", "replace").splitlines():
        words = line.strip().split(None, 1)
        if len(words) == 2:
            key, rest = words[0].lower(), words[1].strip()
            if key == "newmtl":
                current = materials.setdefault(rest, {})
            else:
                current[key] = rest
    return materials


def _material(entries: dict[str, str], resources: Resources, textures: dict[str, Texture | None]) -> Material:
    colour = floats_of(entries.get("kd", "1 1 1" if "map_kd" in entries else "0.8 0.8 0.8"))
    if len(colour) == 1:
        colour = np.repeat(colour, 3)
    colour = colour[:3] if len(colour) >= 3 else np.full(3, 0.8)
    bad = ~np.isfinite(colour)
    opacity = floats_of(entries["d"].replace("-halo", "")) if "d" in entries else 1 - floats_of(entries.get("tr", "0"))
    alpha = float(opacity[0]) if len(opacity) and np.isfinite(opacity[0]) else 1.0
    rgba = to_colours(np.append(np.where(bad, 0.8, colour), alpha)[None])[0]
    images: list[Texture | None] = []
    missing = 0
    scale, offset = (1.0, 1.0), (0.0, 0.0)
    for key in ("map_kd", "map_d"):
        image = None
        if key in entries:
            name, wanted_scale, wanted_offset = _map(entries[key])
            if key == "map_kd":
                scale, offset = wanted_scale, wanted_offset
            if name not in textures:
                textures[name] = Texture.decode(resources.read(name))
            image = textures[name]
            missing += image is None
        images.append(image)
    return Material(rgba, images[0], images[1], scale, offset, missing, int(bad.any()))


def _map(text: str) -> tuple[str, tuple[float, float], tuple[float, float]]:
    """File name, scale and offset of a texture statement; other options are passed over."""
    words = text.split()
    vectors = {"-s": [1.0, 1.0, 1.0], "-o": [0.0, 0.0, 0.0], "-t": [0.0, 0.0, 0.0]}
    lengths = {
        "-blendu": 1,
        "-blendv": 1,
        "-cc": 1,
        "-clamp": 1,
        "-bm": 1,
        "-boost": 1,
        "-imfchan": 1,
        "-texres": 1,
        "-mm": 2,
    }
    at = 0
    while at < len(words) - 1 and (words[at] in vectors or words[at] in lengths):
        option = words[at]
        at += 1
        if option in lengths:
            at += lengths[option]
            continue
        for axis in range(3):
            value = floats_of(words[at] if at < len(words) - 1 else "")
            if len(value) != 1 or not np.isfinite(value[0]):
                break
            vectors[option][axis] = float(value[0])
            at += 1
    name = " ".join(words[at:]) if at else text
    (u, v), (x, y) = vectors["-s"][:2], vectors["-o"][:2]
    return name, (u, v), (x, y)
