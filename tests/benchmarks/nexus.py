"""Nexus at work, for `compare_nexus.py`: runs in a Python that has pymeshlab, which this project does not depend on.

    python nexus.py build FULL.ply OUT.nxs          seconds of building, as JSON
    python nexus.py cuts IN.nxs FOLDER PART ...     cuts with about these parts of the triangles, as PLY files
    python nexus.py distances FULL.ply CUT.ply ...  largest two-sided distance of each, sampled, as JSON

A cut takes with each node all that it depends on; what of a node is drawn are the patches whose refinement is not.

Based on: P. Cignoni et al., Batched Multi Triangulation, IEEE Visualization 2005 (the structure that Nexus keeps).
"""

from __future__ import annotations

import json
import struct
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

#: Bytes of the types of attributes, by their numbers.
TYPE_BYTES = (0, 1, 1, 2, 2, 4, 4, 4, 8)
HEADER_BYTES = 88
#: Offsets of nodes count blocks of so many bytes.
BLOCK = 256
#: Points sampled on each of two surfaces.
SAMPLES = 200_000

NODE = np.dtype(
    [
        ("offset", "<u4"),
        ("vertices", "<u2"),
        ("faces", "<u2"),
        ("error", "<f4"),
        ("cone", "<i2", (4,)),
        ("sphere", "<f4", (4,)),
        ("tight_radius", "<f4"),
        ("first_patch", "<u4"),
    ]
)
PATCH = np.dtype([("node", "<u4"), ("end", "<u4"), ("texture", "<u4")])


class Nexus:
    """An uncompressed .nxs file."""

    def __init__(self, path: Path) -> None:
        self._data = path.read_bytes()
        self._vertex_bytes = sum(
            TYPE_BYTES[self._data[at]] * self._data[at + 1] for at in range(24, 40, 2)
        )  # of all attributes of a vertex
        nodes, patches, _ = struct.unpack_from("<III", self._data, 60)
        self.nodes = np.frombuffer(self._data, NODE, nodes, HEADER_BYTES)
        self.patches = np.frombuffer(self._data, PATCH, patches, HEADER_BYTES + nodes * NODE.itemsize)
        self._sink = nodes - 1

    def cut(self, error: float) -> tuple[np.ndarray, np.ndarray]:
        """Points (n, 3) and triangles (m, 3) of the cut in which no node with a larger error is left unrefined."""
        first = self.nodes["first_patch"]
        own = [self.patches[first[node] : first[node + 1]] for node in range(self._sink)]
        chosen = np.zeros(len(self.nodes), np.bool_)
        chosen[0] = True
        for node in range(self._sink):
            if chosen[node] and self.nodes["error"][node] > error:
                chosen[own[node]["node"]] = True
        chosen[self._sink] = False
        for node in range(self._sink - 1, -1, -1):
            chosen[node] |= chosen[own[node]["node"]].any()
        points, triangles, count = [], [], 0
        for node in np.flatnonzero(chosen).tolist():
            row = self.nodes[node]
            start = int(row["offset"]) * BLOCK
            vertices = np.frombuffer(self._data, "<f4", 3 * int(row["vertices"]), start).reshape(-1, 3)
            start += int(row["vertices"]) * self._vertex_bytes
            faces = np.frombuffer(self._data, "<u2", 3 * int(row["faces"]), start).reshape(-1, 3)
            begin = 0
            for patch in own[node]:
                if not chosen[patch["node"]]:
                    triangles.append(faces[begin : patch["end"]].astype(np.int64) + count)
                begin = int(patch["end"])
            points.append(vertices)
            count += len(vertices)
        used, corners = np.unique(np.concatenate(triangles), return_inverse=True)
        return np.concatenate(points)[used], corners.reshape(-1, 3)


def write_ply(path: Path, points: np.ndarray, triangles: np.ndarray) -> None:
    """A binary PLY file of points (n, 3) and triangles (m, 3)."""
    rows = np.zeros(len(triangles), [("corners", "u1"), ("vertices", "<i4", (3,))])
    rows["corners"], rows["vertices"] = 3, triangles
    head = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(points)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    path.write_bytes(head.encode() + np.asarray(points, "<f4").tobytes() + rows.tobytes())


def build(full: Path, out: Path) -> dict[str, Any]:
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    begin = time.perf_counter()
    begin_cpu = time.process_time()
    meshes.nxs_build(input_file=str(full), output_file=str(out))
    return {
        "seconds": time.perf_counter() - begin,
        "core_seconds": time.process_time() - begin_cpu,
        "bytes": out.stat().st_size,
    }


def cuts(path: Path, folder: Path, parts: list[float]) -> list[dict[str, Any]]:
    nexus = Nexus(path)
    found = {}
    for error in np.unique(np.quantile(nexus.nodes["error"][:-1], np.linspace(0, 1, 60))):
        points, triangles = nexus.cut(float(error))
        found[len(triangles)] = (points, triangles)
    most = max(found)
    results = []
    for part in parts:
        count = min(found, key=lambda n: abs(np.log(n / (part * most))))
        file = folder / f"nexus_{count}.ply"
        write_ply(file, *found[count])
        results.append({"triangles": count, "file": str(file)})
    return results


def distances(full: Path, others: list[Path]) -> list[float]:
    import pymeshlab

    found = []
    for other in others:
        meshes = pymeshlab.MeshSet(verbose=False)
        meshes.load_new_mesh(str(full))
        meshes.load_new_mesh(str(other))
        found.append(
            max(
                meshes.get_hausdorff_distance(
                    sampledmesh=a, targetmesh=1 - a, samplenum=SAMPLES, maxdist=pymeshlab.PercentageValue(100)
                )["max"]
                for a in (0, 1)
            )
        )
    return found


def main() -> None:
    command, *rest = sys.argv[1:]
    if command == "build":
        result: Any = build(Path(rest[0]), Path(rest[1]))
    elif command == "cuts":
        result = cuts(Path(rest[0]), Path(rest[1]), [float(part) for part in rest[2:]])
    elif command == "distances":
        result = distances(Path(rest[0]), [Path(other) for other in rest[1:]])
    else:
        raise SystemExit(__doc__)
    print(json.dumps(result))


if __name__ == "__main__":
    main()
