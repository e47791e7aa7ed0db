"""What readers need of memory: constants that several share, of text, and of images.

All are measured, on meshes that share their vertices and on triangle soups, and rounded up.
"""

from __future__ import annotations

import io
from collections.abc import Iterable
from pathlib import Path

from jobs.importing.reading.content import Content, FileContent
from jobs.importing.reading.resources import Resources

#: Bytes for each vertex and each triangle of a mesh while it is read, repaired and written.
VERTEX, TRIANGLE = 290, 110

#: Bytes for each vertex of a mesh that is textured, for each texel that is held, and of the image that is read.
TEXTURED_VERTEX, HELD_TEXEL, TEXEL = 330, 6, 60

#: Bytes for each byte of a file that is text, and is read whole.
TEXT = 20

#: An image's size is found in this many bytes from its file's start; if not, each byte counts as that many texels.
_IMAGE_HEAD, _TEXELS = 1 << 16, 20

_IMAGES = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tga", ".tif", ".tiff", ".gif", ".dds", ".ppm")


def text_needs(_file: Path, content: Content, _resources: Resources) -> int:
    """Bytes that a file may take which is text, is read whole, and names no images."""
    return TEXT * content.size


def image_needs(references: Iterable[str], resources: Resources) -> int:
    """Bytes that the images among the files that a model names may take, all held at once."""
    files = {file for reference in references if (file := resources.find(reference)) is not None}
    texels = [texels_of(FileContent(file)) for file in files if file.suffix.lower() in _IMAGES]
    return TEXEL * max(texels, default=0) + HELD_TEXEL * sum(texels)


def texels_of(image: Content) -> int:
    """Texels of an image file, from its first bytes."""
    from PIL import Image

    try:
        with Image.open(io.BytesIO(image.part(0, min(image.size, _IMAGE_HEAD)))) as found:
            return found.width * found.height
    except Exception:  # Pillow raises almost anything on what it does not know, or needs more of
        return _TEXELS * image.size
