"""Compressed files for tests: made by the same libraries that decode them, in the form that exporters write."""

from __future__ import annotations

import DracoPy
import meshopt
import numpy as np

from tests.jobs.importing.shapes import Glb

DRACO = "KHR_draco_mesh_compression"
MESHOPT = "EXT_meshopt_compression"


def draco_primitive(glb: Glb, positions, triangles, data=False, **attributes) -> dict:
    """A primitive under KHR_draco_mesh_compression; `data`: its accessors have the data uncompressed as well."""
    attributes = {"POSITION": np.asarray(positions, "<f4"), **attributes}
    names = {"NORMAL": "normals", "TEXCOORD_0": "tex_coord", "COLOR_0": "colors"}
    given = {names[name]: values for name, values in attributes.items() if name in names}
    if "normals" in given:  # only these have to have 64 bits
        given["normals"] = np.asarray(given["normals"], np.float64)
    generic = {10: attributes["JOINTS_0"]} if "JOINTS_0" in attributes else None
    stream = DracoPy.encode(
        attributes["POSITION"],
        np.asarray(triangles, np.uint32),
        quantization_bits=20,
        preserve_order=True,
        generic_attributes=generic,
        **given,
    )
    decoded = DracoPy.decode(stream)
    kinds = {0: "POSITION", 1: "NORMAL", 2: "COLOR_0", 3: "TEXCOORD_0", 4: "JOINTS_0"}
    ids = {kinds[entry["attribute_type"]]: entry["unique_id"] for entry in decoded.attributes}
    primitive = glb.primitive(
        positions, triangles, **{name: attributes[name] for name in attributes if name != "POSITION"}
    )
    vertices = len(decoded.points)
    for number in primitive["attributes"].values():
        if not data:
            del glb.header["accessors"][number]["bufferView"]
            glb.header["accessors"][number]["count"] = vertices
    if not data:
        del glb.header["accessors"][primitive["indices"]]["bufferView"]
    extension = {"bufferView": glb.view(stream), "attributes": ids}
    glb.header.setdefault("extensionsUsed", []).append(DRACO)
    return {**primitive, "extensions": {DRACO: extension}}


def compress_view(glb: Glb, accessor: int, rows, mode: str, filter_=None, name=MESHOPT, version=0) -> None:
    """Put an accessor's view under a meshopt extension; `rows` (n, stride bytes), or indices, are what is encoded."""
    rows = np.ascontiguousarray(rows)
    if mode == "ATTRIBUTES":
        data = meshopt.encode_vertex_buffer_level(rows, 2, version)
        stride = rows.nbytes // len(rows)
    else:
        data = (meshopt.encode_index_buffer if mode == "TRIANGLES" else meshopt.encode_index_sequence)(rows)
        stride = rows.itemsize
    view = glb.view(data)
    at = glb.header["accessors"][accessor]["bufferView"]
    entry = {"buffer": 0, "byteOffset": glb.header["bufferViews"][view]["byteOffset"], "byteLength": len(data)}
    entry |= {"byteStride": stride, "count": len(rows), "mode": mode}
    if filter_ is not None:
        entry["filter"] = filter_
    glb.header["bufferViews"][at] = {
        "buffer": 1,
        "byteOffset": 0,
        "byteLength": len(rows) * stride,
        **({"byteStride": stride} if mode == "ATTRIBUTES" else {}),
        "extensions": {name: entry},
    }
    glb.header["accessors"][accessor].pop("byteOffset", None)


def placeholder(name=MESHOPT) -> dict:
    """A buffer that is not there: fallback data that was left out."""
    return {"byteLength": 1 << 20, "extensions": {name: {"fallback": True}}}
