"""Materials become colours and alpha of vertices.

glTF 2.0, sections 3.9.2 (base colour), 3.9.4 (alpha: OPAQUE ignores it, MASK compares it with alphaCutoff, BLEND
blends); KHR_materials_transmission, KHR_materials_pbrSpecularGlossiness. Base colour times texture times vertex colour,
in linear light; trimesh stores vertex colours in sRGB instead, and means their alpha where there is no material. See
`jobs.importing.reading.see_through` for what becomes of alpha.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from jobs.importing.formats.gltf.header import Json
from jobs.importing.formats.gltf.textures import Textures, coordinate_set, moved
from jobs.importing.reading.defects import Defect
from jobs.importing.reading.see_through import AlphaMode, SeenThrough, see_through
from jobs.importing.reading.texture_alpha import AlphaOver, TextureAlpha, Wrap
from jobs.importing.reading.vertex_colours import (
    DEFAULT_COLOUR,
    Texture,
    from_linear,
    srgb_to_linear,
    to_bytes,
    to_colours,
)

_MODES = {"OPAQUE": AlphaMode.OPAQUE, "MASK": AlphaMode.MASK, "BLEND": AlphaMode.BLEND}

_TRANSMISSION = "KHR_materials_transmission"

#: What lets all light through is still drawn with this alpha: glass has an outline.
_CLEAREST = 0.1


class Attributes(Protocol):
    """A primitive's arrays by their names."""

    def __contains__(self, name: object) -> bool: ...

    def floats(self, name: str) -> np.ndarray:
        """An attribute's values (n, width) float64."""
        ...


@dataclass(frozen=True, eq=False)
class Painted:
    """A primitive whose vertices have their colours; some were split for it."""

    vertices: np.ndarray | None  # (k,) int64: the vertex that each vertex was; None: all, as they were
    triangles: np.ndarray  # (m, 3) int64
    colours: np.ndarray  # (k, 4) uint8


@dataclass(frozen=True, eq=False)
class _Layer:
    """An image as it lies on a primitive's triangles."""

    texture: Texture | None  # None if it is missing
    places: np.ndarray  # (n, 2)
    wraps: tuple[Wrap, Wrap]
    inside: np.ndarray  # (m,) bool: triangles whose corners have places

    def over(self, channel: TextureAlpha, triangles: np.ndarray) -> AlphaOver:
        """The least, mean and greatest value of one of its channels over each triangle; 255 where it has no place."""
        found = AlphaOver(*(np.full(len(triangles), 255, dtype) for dtype in (np.uint8, np.float64, np.uint8)))
        for all_of_them, values in zip(
            found, channel.over(self.places, triangles[self.inside], self.wraps), strict=True
        ):
            all_of_them[self.inside] = values
        return found


def paint(
    textures: Textures,
    attributes: Attributes,
    material: Json | None,
    triangles: np.ndarray,
    vertices: int,
    defects: dict[Defect, int],
) -> Painted:
    """The colours of a primitive's `vertices`; triangles (m, 3) int64, of which indices may be out of range."""
    if material is None and "COLOR_0" not in attributes:
        return Painted(None, triangles, np.broadcast_to(np.array(DEFAULT_COLOUR, np.uint8), (vertices, 4)))
    header = textures.accessors.header
    by_trimesh = "trimesh" in str(header["asset"].get("generator", ""))
    if material is None:
        material = {"alphaMode": "BLEND"} if by_trimesh else {}
    factor, image = _base_colour(material)
    mode = _MODES.get(material.get("alphaMode", "OPAQUE"), AlphaMode.OPAQUE)
    linear = np.ones((vertices, 4))
    linear *= _factor(factor, header)
    thin: AlphaOver | None = None
    layer = None if image is None else _layer(textures, attributes, image, triangles)
    if layer is not None and layer.texture is None:
        defects[Defect.NO_TEXTURE] = defects.get(Defect.NO_TEXTURE, 0) + 1
        thin = _unknown(len(triangles))
    elif layer is not None and layer.texture is not None:
        shown = layer.texture.opaque if mode is AlphaMode.OPAQUE else layer.texture
        sampled = shown.sample(layer.places, triangles[layer.inside], layer.wraps)
        linear[:, :3] *= srgb_to_linear(sampled[:, :3])
        thin = layer.over(shown.alpha, triangles)
    painted = _vertex_colours(attributes, vertices, defects)
    if painted is not None and layer is None and by_trimesh and (linear == 1).all():
        linear[:, 3] = painted[:, 3] if painted.shape[1] > 3 else 1.0
        colours = to_colours(painted)
    else:
        if painted is not None:
            linear[:, : painted.shape[1]] *= painted
        colours = from_linear(linear[:, :3])
    settled = see_through(triangles, linear[:, 3], mode, float(material.get("alphaCutoff", 0.5)), thin)
    chosen, triangles, alpha = settled
    let_through = _transmission(textures, attributes, material, settled)
    if let_through is not None:
        again = see_through(triangles, alpha / 255, AlphaMode.BLEND, 0.0, let_through)
        chosen, triangles, alpha = chosen[again.vertices], again.triangles, again.alpha
    same = len(chosen) == vertices and bool((chosen == np.arange(vertices)).all())
    colours = colours if same else colours[chosen]
    colours[:, 3] = alpha
    return Painted(None if same else chosen, triangles, colours)


def may_split(material: Json) -> bool:
    """Whether triangles of a textured material may need vertices of their own."""
    return material.get("alphaMode", "OPAQUE") != "OPAQUE" or _TRANSMISSION in material.get("extensions", {})


def _base_colour(material: Json) -> tuple[Sequence[float], Json | None]:
    """A material's base colour and the texture that goes with it."""
    older = material.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness")
    if older is not None and "pbrMetallicRoughness" not in material:
        return older.get("diffuseFactor", (1, 1, 1, 1)), older.get("diffuseTexture")
    surface = material.get("pbrMetallicRoughness", {})
    return surface.get("baseColorFactor", (1, 1, 1, 1)), surface.get("baseColorTexture")


def _factor(factor: Sequence[float], header: Json) -> np.ndarray:
    """A base colour (4,) in linear light. IfcOpenShell writes sRGB values where glTF wants linear ones."""
    values = np.nan_to_num(np.array(factor, np.float64).reshape(4))
    if "ifcopenshell" in str(header["asset"].get("generator", "")).lower():
        values[:3] = srgb_to_linear(to_bytes(values[:3]))
    return values


def _vertex_colours(attributes: Attributes, vertices: int, defects: dict[Defect, int]) -> np.ndarray | None:
    """COLOR_0 (n, 3 or 4); white where it is not finite, which is counted."""
    if "COLOR_0" not in attributes:
        return None
    painted = attributes.floats("COLOR_0")
    if len(painted) != vertices:
        raise ValueError(f"{len(painted)} colours of {vertices} vertices")
    bad = ~np.isfinite(painted).all(axis=1)
    if bad.any():
        painted = np.where(bad[:, None], 1.0, painted)
        defects[Defect.COLOUR] = defects.get(Defect.COLOUR, 0) + int(bad.sum())
    return painted


def _layer(textures: Textures, attributes: Attributes, image: Json, triangles: np.ndarray) -> _Layer | None:
    """A material's image as it lies on a primitive; None where the primitive does not say how it lies."""
    name = coordinate_set(image)
    texture = textures.image(image["index"])
    if texture is None:
        return _Layer(None, np.empty((0, 2)), (Wrap.REPEAT, Wrap.REPEAT), np.zeros(len(triangles), bool))
    if name not in attributes:
        return None
    places = moved(attributes.floats(name)[:, :2], image)
    inside: np.ndarray = np.all((triangles >= 0) & (triangles < len(places)), axis=1)
    return _Layer(texture, places, textures.wraps(image["index"]), inside)


def _unknown(triangles: int) -> AlphaOver:
    """The alpha of an image that is missing: what may be seen through must not hide anything."""
    least, greatest = np.zeros(triangles, np.uint8), np.full(triangles, 255, np.uint8)
    return AlphaOver(least, greatest.astype(np.float64), greatest)


def _transmission(textures: Textures, attributes: Attributes, material: Json, settled: SeenThrough) -> AlphaOver | None:
    """What KHR_materials_transmission leaves of the alpha of each triangle, None if it lets nothing through."""
    entry = material.get("extensions", {}).get(_TRANSMISSION, {})
    factor = float(entry.get("transmissionFactor", 0.0))
    if not factor > 0:
        return None
    count = len(settled.triangles)
    shares = [np.full(count, 255.0)] * 3
    image = entry.get("transmissionTexture")
    layer = None if image is None else _layer(textures, _Split(attributes, settled.vertices), image, settled.triangles)
    if layer is not None and layer.texture is not None:  # its red channel
        shares = [share.astype(np.float64) for share in layer.over(layer.texture.red, settled.triangles)]
    most, mean, least = (255 * np.maximum(1 - min(factor, 1.0) * share / 255, _CLEAREST) for share in shares)
    return AlphaOver(np.rint(least).astype(np.uint8), mean, np.rint(most).astype(np.uint8))


@dataclass(frozen=True, eq=False)
class _Split:
    """The attributes of vertices that were split."""

    attributes: Attributes
    vertices: np.ndarray  # (k,) int64

    def __contains__(self, name: object) -> bool:
        return name in self.attributes

    def floats(self, name: str) -> np.ndarray:
        """See `Attributes`."""
        return self.attributes.floats(name)[self.vertices]
