"""Real models, clean and dirty: all of their triangles are accounted for."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from tests.jobs.importing.shapes import imported

FOLDER = Path(os.environ.get("VLOD_MODELS", "/nowhere"))

pytestmark = pytest.mark.skipif("VLOD_MODELS" not in os.environ, reason="VLOD_MODELS does not name a folder of models")

#: file, triangles of all placements as counted by others, meshes, parts, up, metres per unit.
MODELS = [
    ("small_willowgarage/willowgarage_visual.dae", 13839, 248, 248, "z", 0.02539999969303608),
    ("mid_conference/conference.obj", 331179, 41, 41, "y", 1.0),
    ("mid_lost_empire/lost_empire.obj", 224998, 45, 45, "y", 1.0),
    ("mid_hospital/hospital_three_floors.glb", 435855, 26, 209, "y", 1.0),
    ("large_ldraw/deathstar10143.glb", 3081184, 139, 3457, "y", 1.0),
    ("large_ldraw/townhall10224.glb", 1307423, 345, 2799, "y", 1.0),
    ("cad_atlas/atlas_detector.glb", 858758, 102, 102, "y", 1.0),
    ("cad_sportscar/sportsCar.obj", 300603, 1075, 1075, "y", 1.0),
    ("bim_schependomlaan/schependomlaan_subcontractors.glb", 135874, 2222, 2245, "y", 1.0),
    ("dirty/busted.STL", 3878, 1, 1, "z", 1.0),
    ("dirty/capsule.obj", 10200, 1, 1, "y", 1.0),
    ("dirty/chair_model.obj", 12756, 4, 4, "y", 1.0),
    ("dirty/cycloidal.ply", 43368, 1, 1, "z", 1.0),
    ("dirty/gazebo_cafe.dae", 23834, 353, 459, "z", 0.0254),
    ("dirty/nancolor.obj", 12, 1, 1, "y", 1.0),
]

#: The whole reports of these files.
DEFECTS: dict[str, dict[str, int]] = {
    "dirty/busted.STL": {},
    "dirty/capsule.obj": {"faces without area": 200, "missing material libraries": 1},
    "dirty/chair_model.obj": {
        "duplicate faces": 4,
        "duplicate faces of opposite winding": 6378,
        "missing material libraries": 1,
    },
    "dirty/cycloidal.ply": {},
    "dirty/gazebo_cafe.dae": {
        "faces without area": 194,
        "duplicate faces of opposite winding": 5370,
        "faces left out that show another colour to the other side": 1181,
        "missing textures": 111,
        "points, lines and other primitives without triangles": 35,
    },
    "dirty/nancolor.obj": {"colours that are not finite": 1},
    "cad_atlas/atlas_detector.glb": {"faces without area": 88},
    "mid_conference/conference.obj": {},
    "mid_lost_empire/lost_empire.obj": {"invisible faces": 52},
    "large_ldraw/deathstar10143.glb": {},
}


@pytest.mark.parametrize(
    ("name", "triangles", "meshes", "parts", "up", "unit"), MODELS, ids=[model[0] for model in MODELS]
)
def test_every_triangle_is_kept_or_counted(tmp_path, name, triangles, meshes, parts, up, unit):
    model = imported(FOLDER / name, tmp_path / "out")
    removed = sum(counts["total"] for defect, counts in model.report.items() if "faces" in defect)
    assert model.triangle_count + removed == triangles
    assert (len(model.meshes), len(model.parts), model.up, model.unit_in_metres) == (meshes, parts, up, unit)
    assert np.isfinite(model.positions).all()
    assert (model.hi > model.lo).all()
    for counts in model.report.values():
        assert counts["total"] == sum(counts["parts"].values())
    if name in DEFECTS:
        assert {defect: counts["total"] for defect, counts in model.report.items()} == DEFECTS[name]


def test_importing_twice_gives_the_same_bytes(tmp_path):
    for folder in ("a", "b"):
        imported(FOLDER / "mid_lost_empire" / "lost_empire.obj", tmp_path / folder)
    for file in (tmp_path / "a").iterdir():
        assert file.read_bytes() == (tmp_path / "b" / file.name).read_bytes()


def test_a_folder_of_real_files(tmp_path):
    model = imported(FOLDER / "dirty", tmp_path / "out")
    assert {name.split("/")[0] for name in model.names} == {Path(m[0]).name for m in MODELS if m[0].startswith("dirty")}
