"""Images of textures, and where they lie on a primitive.

glTF 2.0, sections 3.8 (textures, samplers) and 3.9.2; KHR_texture_transform; EXT_texture_webp.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from jobs.importing.formats.gltf.accessors import Accessors, at
from jobs.importing.formats.gltf.header import Json
from jobs.importing.reading.resources import Resources
from jobs.importing.reading.texture_alpha import Wrap
from jobs.importing.reading.vertex_colours import Texture

_WRAPS = {33071: Wrap.CLAMP, 33648: Wrap.MIRROR, 10497: Wrap.REPEAT}

#: Textures are kept for the next mesh up to this many bytes.
TEXTURES_KEPT = 1 << 26


@dataclass(eq=False)
class Textures:
    """A file's textures, decoded as they are asked for."""

    accessors: Accessors
    resources: Resources
    _kept: dict[int, Texture | None] = field(default_factory=dict)  # the one used last comes last

    def image(self, number: int) -> Texture | None:
        """A texture's image, None if it is missing or cannot be read."""
        if number in self._kept:
            self._kept[number] = self._kept.pop(number)
        else:
            self._kept[number] = Texture.decode(self._file(number))
            while len(self._kept) > 1 and self._held() > TEXTURES_KEPT:
                del self._kept[next(iter(self._kept))]
        return self._kept[number]

    def _held(self) -> int:
        return sum(texture.held for texture in self._kept.values() if texture is not None)

    def _file(self, number: int) -> bytes | None:
        """The file of a texture's image, None if it is missing."""
        header = self.accessors.header
        entry = header["textures"][at(number)]
        source = entry.get("source", entry.get("extensions", {}).get("EXT_texture_webp", {}).get("source"))
        image = {} if source is None else header["images"][at(source)]
        if "bufferView" in image:
            return self.accessors.whole_view(image["bufferView"])
        return self.resources.read(str(image["uri"])) if "uri" in image else None

    def wraps(self, number: int) -> tuple[Wrap, Wrap]:
        """How a texture goes on beside its image, across and down."""
        entry = self.accessors.header["textures"][at(number)]
        sampler = self.accessors.header["samplers"][at(entry["sampler"])] if "sampler" in entry else {}
        across, down = (_WRAPS.get(sampler.get(key, 10497), Wrap.REPEAT) for key in ("wrapS", "wrapT"))
        return across, down


def coordinate_set(image: Json) -> str:
    """The attribute that says where a material's image lies; KHR_texture_transform may name another."""
    transform = image.get("extensions", {}).get("KHR_texture_transform", {})
    return f"TEXCOORD_{transform.get('texCoord', image.get('texCoord', 0))}"


def moved(places: np.ndarray, image: Json) -> np.ndarray:
    """Texture coordinates (n, 2) under KHR_texture_transform: scaled, turned, shifted."""
    transform = image.get("extensions", {}).get("KHR_texture_transform")
    if transform is None:
        return places
    angle = float(transform.get("rotation", 0.0))
    across, down = (float(value) for value in transform.get("scale", (1.0, 1.0)))
    u, v = places[:, 0] * across, places[:, 1] * down
    x, y = (float(value) for value in transform.get("offset", (0.0, 0.0)))
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.stack([u * cosine + v * sine + x, v * cosine - u * sine + y], axis=1)
