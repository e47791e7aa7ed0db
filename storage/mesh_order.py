from __future__ import annotations
from storage.geometry import MeshArrays
import numpy as np

def ordered(mesh: MeshArrays) -> MeshArrays:
    return MeshArrays(np.asarray(mesh.positions,np.int32).reshape(-1,3), np.asarray(mesh.triangles,np.uint32).reshape(-1,3), np.asarray(mesh.normals,np.float32).reshape(-1,3), np.asarray(mesh.colours,np.uint8).reshape(-1,4), mesh.source_faces, mesh.scale)
