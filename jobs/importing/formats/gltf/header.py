"""A file's JSON header and binary chunk, and the extensions that it may require.

glTF 2.0, sections 3.2 (asset), 3.12 (extensions) and 4 (GLB). A file lists in extensionsRequired what cannot be left
aside when it is read; what is not known there is a refusal.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from jobs.importing.reading.content import Content, ContentPart, whole
from storage.base.errors import ModelError

Json = dict[str, Any]

DRACO = "KHR_draco_mesh_compression"
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
INSTANCING = "EXT_mesh_gpu_instancing"
VISIBILITY = "KHR_node_visibility"

#: Extensions that are read.
_READ = {
    DRACO,
    *MESHOPT,
    INSTANCING,
    VISIBILITY,
    "EXT_texture_webp",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_transmission",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
}

#: Extensions that change neither what geometry there is nor where; by the starts of their names.
_HARMLESS = (
    "ADOBE_materials_",
    "AGI_",
    "CESIUM_primitive_outline",
    "EXT_feature_metadata",
    "EXT_instance_features",
    "EXT_lights_",
    "EXT_mesh_features",
    "EXT_mesh_manifold",
    "EXT_nodes_metadata",
    "EXT_structural_metadata",
    "EXT_texture_",
    "FB_geometry_metadata",
    "GODOT_",
    "KHR_animation_pointer",
    "KHR_audio",
    "KHR_environment_map",
    "KHR_implicit_shapes",
    "KHR_interactivity",
    "KHR_lights_",
    "KHR_materials_",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_physics_rigid_bodies",
    "KHR_techniques_webgl",
    "KHR_texture_",
    "KHR_xmp",
    "MSFT_audio_emitter",
    "MSFT_lod",
    "MSFT_packing_",
    "MSFT_texture_dds",
    "NV_materials_",
    "OMI_",
    "VRM",
    "WEB3D_quantized_attributes_metadata",
)


def unpacked(file: Path, content: Content) -> tuple[Json, Content | None]:
    """The JSON header and, in a .glb file, the binary chunk. Raises ModelError."""
    if file.suffix.lower() == ".gltf":
        header = json.loads(whole(content))
        chunk: Content | None = None
    else:
        header, chunk = _of_glb(file, content)
    if not isinstance(header, dict) or "asset" not in header:
        raise ModelError(f"{file}: JSON, but not glTF (it has no asset); check its extension")
    return header, chunk


def _of_glb(file: Path, content: Content) -> tuple[Any, Content | None]:
    if content.part(0, 4) != b"glTF":
        raise ModelError(f"{file}: not a GLB file, it does not start with glTF; check its extension or export it again")
    if content.size < 20:
        raise _cut(file, 20, content.size)
    version, total, length = (int(n) for n in np.frombuffer(content.part(4, 16), "<u4"))
    if version != 2:
        raise ModelError(f"{file}: GLB version {version}; only version 2 is read, convert the file")
    if total > content.size or 20 + length > content.size:
        raise _cut(file, max(total, 20 + length), content.size)
    header = json.loads(content.part(20, 20 + length))
    start, chunk = 20 + length, None
    while start + 8 <= content.size and chunk is None:
        head = content.part(start, start + 8)
        length = int.from_bytes(head[:4], "little")
        if start + 8 + length > content.size:
            raise _cut(file, start + 8 + length, content.size)
        chunk = ContentPart(content, start + 8, length) if head[4:] == b"BIN\0" else None
        start += 8 + length
    return header, chunk


def _cut(file: Path, expected: int, found: int) -> ModelError:
    return ModelError(f"{file}: cut short, {found} of {expected} bytes are there; copy or export it again")


def check_versions(file: Path, header: Json) -> None:
    """Raises ModelError for another version of glTF, and for a required extension that is not known."""
    version = str(header["asset"].get("version", "2.0"))
    if not version.startswith("2"):
        raise ModelError(f"{file}: glTF version {version[:20]}; only version 2 is read, convert the file")
    unknown = sorted({str(name)[:80] for name in header.get("extensionsRequired", ()) if not is_known(str(name))})
    if unknown:
        raise ModelError(f"{file}: requires {', '.join(unknown[:5])}, which is not read; export the model without it")


def is_known(extension: str) -> bool:
    """Whether an extension is read, or changes neither geometry nor its place."""
    return extension in _READ or extension.startswith(_HARMLESS)


def unread_extensions(entry: Json) -> list[str]:
    """The extensions of a node, mesh or primitive that may change geometry or its place and are not read."""
    return [name for name in entry.get("extensions", {}) if not is_known(name)]


def references(header: Json, section: str) -> list[str]:
    """The files that the entries of a section name."""
    uris = [str(entry["uri"]) for entry in header.get(section, ()) if "uri" in entry]
    return [uri for uri in uris if not uri.startswith("data:")]


def name_of(entry: Json, otherwise: str) -> str:
    """The name of an entry, if it has one; halves of characters in it are written as escapes."""
    name = str(entry.get("name") or otherwise)
    return name if name.isascii() else name.encode(errors="backslashreplace").decode()
