"""What can be seen through: parted from what is opaque at import, and in a tree of its own from there on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from jobs.detail.inner import MOST_LEVELS
from jobs.importing.model import MeshView, Part, write_model
from jobs.importing.reading.source_scene import SourceMesh
from jobs.importing.repair import repair
from jobs.parameters import BuildParameters
from jobs.pipeline import build
from jobs.running.executors import SerialExecutor
from storage import open_store
from storage.geometry_reader import Geometry
from storage.meshes.placement import IDENTITY
from storage.model.cut import coarsest_triangles, cut_within
from storage.model.tree import leaves, roots
from tests.jobs.built_geometry import Built, build_geometry, build_levels
from tests.jobs.detail.shapes import Shape, box, grid, joined, sphere, torus
from tests.jobs.glass_model import painted, write_glass

PARAMETERS = BuildParameters(max_depth=1, triangles_per_cell=3000)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    folder = tmp_path_factory.mktemp("glass")
    return build_geometry([write_glass(folder / "glass.ply")], folder / "store", BuildParameters(object_triangles=200))


def check_kinds(built: Built) -> None:
    """Every drawable is of one kind, as it says; so is every tree, the opaque one first; and no face is lost."""
    geometry, model = built.geometry, built.model
    rows, nodes = geometry.drawables, geometry.nodes
    for drawable, row in enumerate(rows):
        assert ((geometry.mesh(drawable).colours[:, 3] < 255) == row["see_through"]).all()
    assert not (rows["see_through"] & rows["one_sided"]).any()
    of_node = rows["see_through"][nodes["first_drawable"]]
    assert (rows["see_through"] == of_node[rows["node"]]).all()
    tops = roots(nodes).tolist()
    assert of_node[tops].tolist() in ([False], [True], [False, True])
    for top in tops:
        assert (of_node[top : nodes["end"][top]] == of_node[top]).all()
    held: tuple[list[np.ndarray], ...] = ([], [])
    for leaf in np.flatnonzero(leaves(nodes)).tolist():
        held[int(of_node[leaf])].append(np.stack(geometry.source_faces(int(nodes["first_drawable"][leaf])), axis=1))
    meant: tuple[list[np.ndarray], ...] = ([], [])
    for part, row in enumerate(model.parts):
        mesh = model.mesh(int(row["mesh"]))
        clear = mesh.colours[mesh.triangles, 3] < 255
        assert (clear.any(axis=1) == clear.all(axis=1)).all()
        for kind in (0, 1):
            faces = mesh.source_faces[clear[:, 0] == kind]
            meant[kind].append(np.stack([np.full(len(faces), part, np.uint32), faces], axis=1))
    for found, wanted in zip(held, meant, strict=True):
        together = [sorted(map(tuple, np.concatenate([np.zeros((0, 2)), *some]).tolist())) for some in (found, wanted)]
        assert together[0] == together[1]


def test_levels_are_of_one_kind_and_each_kind_has_a_tree(built: Built) -> None:
    check_kinds(built)
    geometry = built.geometry
    clear = geometry.drawables["see_through"]
    inner = ~leaves(geometry.nodes)[geometry.drawables["node"]]
    for kind in (clear, ~clear):
        assert (kind & inner).sum() > 10, "there is something above the leaves"
        assert (kind & ~inner & (geometry.drawables["level"] > 0)).sum() > 3
    assert geometry.drawables["one_sided"].any()


def test_levels_have_no_alpha_that_the_model_has_not(built: Built) -> None:
    """Sampling, mixing and rounding stay between the least and the greatest alpha of the tree."""
    own = built.model.colours[built.model.colours[:, 3] < 255, 3]
    geometry = built.geometry
    clear = np.flatnonzero(geometry.drawables["see_through"]).tolist()
    alphas = [geometry.mesh(drawable).colours[:, 3] for drawable in clear]
    assert min(alpha.min() for alpha in alphas) >= own.min() > 0
    assert max(alpha.max() for alpha in alphas) <= own.max() == 254
    dome = [alpha for drawable, alpha in zip(clear, alphas, strict=True) if geometry.drawables["level"][drawable] > 1]
    assert len(np.unique(np.concatenate(dome))) > 10, "levels keep a gradient"


def test_any_cut_stands_for_every_leaf_of_both_trees(built: Built) -> None:
    nodes, rows = built.geometry.nodes, built.geometry.drawables
    own = np.flatnonzero(leaves(nodes))
    for error in (0.0, 0.003, 0.1, 1e9):
        cut = cut_within(nodes, rows, error)
        of = rows["node"][cut]
        assert (((of[:, None] <= own) & (own < nodes["end"][of][:, None])).sum(axis=0) == 1).all()
    assert rows["node"][cut].tolist() == roots(nodes).tolist()
    assert (nodes["levels"][roots(nodes)] > MOST_LEVELS).all(), "there is nothing above either, so both go on"
    assert rows["triangles"][cut].sum() == coarsest_triangles(nodes, rows) < 100


def test_a_store_with_glass_has_the_same_bytes_every_time(tmp_path: Path) -> None:
    model = write_glass(tmp_path / "glass.ply")
    contents = []
    for name in ("a", "b"):
        build([model], tmp_path / name, PARAMETERS, SerialExecutor())
        contents.append({path.name: path.read_bytes() for path in (tmp_path / name / "shards").iterdir()})
    assert contents[0] == contents[1]
    store = open_store(tmp_path / "a")
    assert list(store.check()) == []
    assert store.drawables["see_through"][np.concatenate([store.vlod(cell) for cell in range(len(store.cells))])].any()


def test_a_model_that_can_all_be_seen_through(tmp_path: Path) -> None:
    model = write_glass(tmp_path / "glass.ply", opaque=False)
    check_kinds(build_geometry([model], tmp_path / "levels"))
    build([model], tmp_path / "store", PARAMETERS, SerialExecutor())
    store = open_store(tmp_path / "store")
    assert len(roots(store.nodes)) == 1
    assert store.drawables["see_through"].all()
    assert list(store.check()) == []


def test_instances_of_what_is_half_of_glass_share_both_halves(tmp_path: Path) -> None:
    ball = sphere(8)
    colours = painted(ball, (10, 20, 30, 255))
    colours[ball[0][:, 0] > 0, 3] = 50
    mesh, _ = repair(SourceMesh("ball", *ball, colours=colours))
    assert mesh is not None
    places = [np.hstack([np.eye(3), [[3.0 * number], [0], [0]]]) for number in range(7)]
    write_model(tmp_path / "model", [mesh], [Part(0, f"ball {number}", at) for number, at in enumerate(places)])
    built = build_levels(tmp_path / "model", tmp_path / "store")
    check_kinds(built)
    geometry = built.geometry
    finest = geometry.drawables[geometry.nodes["first_drawable"][leaves(geometry.nodes)]]
    assert (finest["instance"] >= 0).all()
    for kind in (False, True):
        own = finest[finest["see_through"] == kind]
        assert len(own) == 7 * len(np.unique(own["geometry"]))


def tree_of(geometry: Geometry, top: int) -> list[tuple]:
    """All that a tree says but for what it is numbered by: rows of nodes and drawables, and their meshes."""
    found = []
    for node in range(top, int(geometry.nodes["end"][top])):
        row = geometry.nodes[node]
        found.append((int(row["end"]) - top, int(row["levels"]), row["lo"].tolist(), row["hi"].tolist()))
        first = int(row["first_drawable"])
        for drawable in range(first, first + int(row["levels"])):
            own = geometry.drawables[drawable]
            mesh = geometry.local_mesh(int(own["geometry"]))
            arrays = (mesh.positions, mesh.triangles, mesh.folded, mesh.colours)
            placed = geometry.instances[own["instance"]].tobytes() if own["instance"] >= 0 else b""
            names = ("level", "triangles", "error", "one_sided", "see_through")
            found.append((*(own[name] for name in names), placed, mesh.scale, *(array.tobytes() for array in arrays)))
    return found


def test_either_kind_is_the_same_whatever_there_is_of_the_other(tmp_path: Path) -> None:
    """Opaque parts with panes among them, in the same meshes and in others, placed once and often."""
    around, steps = box((-5, -5, -5), (5, 5, 5)), np.arange(-2, 2, 0.25)  # a shell of either kind: the same extent
    opaque = [torus(40, 20), around, *(box((x, 0, 3), (x + 0.1, 1, 4)) for x in steps), sphere(6, 0.4)]
    clear = [sphere(4, 0.3), around, *(box((x + 0.1, 0, 3), (x + 0.25, 1, 4)) for x in steps), sphere(9, 0.5)]
    spots = [np.hstack([np.eye(3), [[1.0 * number - 2], [2], [4]]]) for number in range(5)]

    def model(name: str, meshes: list[MeshView]) -> Built:
        balls = [number for number, mesh in enumerate(meshes) if len(mesh.triangles) in (432, 972)]
        assert balls
        parts = [Part(number, "part", IDENTITY) for number in range(len(meshes)) if number not in balls]
        parts += [Part(number, "ball", spot) for number in balls for spot in spots]
        write_model(tmp_path / name, meshes, parts)
        return build_levels(tmp_path / name, tmp_path / f"{name}.store")

    def views(shapes: list[Shape], alpha: int) -> list[MeshView]:
        return [MeshView.of(*shape, colours=painted(shape, (9, 9, 9, alpha))) for shape in shapes]

    colours = np.concatenate([painted(opaque[0], (9, 9, 9, 255)), painted(clear[0], (9, 9, 9, 70))])
    first = MeshView.of(*joined([opaque[0], clear[0]]), colours=colours)
    of_both = model("both", [first, *views(opaque, 255)[1:], *views(clear, 70)[1:]])
    check_kinds(of_both)
    second = int(of_both.geometry.nodes["end"][0])
    assert roots(of_both.geometry.nodes).tolist() == [0, second]
    assert second > 20
    assert len(of_both.geometry.nodes) - second > 20
    assert tree_of(of_both.geometry, 0) == tree_of(model("opaque", views(opaque, 255)).geometry, 0)
    assert tree_of(of_both.geometry, second) == tree_of(model("clear", views(clear, 70)).geometry, 0)


@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 2**32 - 1))
def test_any_mixture_is_parted(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    """Random parts with alpha at random vertices, placed once, often, mirrored; small objects and wide clusters."""
    rng = np.random.default_rng(seed)
    meshes, parts = [], []
    for number in range(int(rng.integers(1, 9))):
        shapes = [
            sphere(int(rng.integers(2, 8))),
            torus(int(rng.integers(3, 30)), 8),
            box(),
            grid(9, rng.random((9, 9))),
        ]
        points, triangles = shapes[rng.integers(4)]
        colours = rng.integers(0, 256, (len(points), 4), np.uint8)
        share = rng.choice([0.0, 0.02, 0.5, 1.0])  # of vertices that are not opaque
        alike = rng.random() < 0.5  # near each other
        opaque = (points[:, 0] > np.quantile(points[:, 0], share)) if alike else rng.random(len(points)) >= share
        colours[opaque, 3] = 255
        mesh, _ = repair(SourceMesh("part", points, triangles.astype(np.int64), colours=colours))
        assert mesh is not None
        meshes.append(mesh)
        for _ in range(int(rng.choice([1, 1, 3]))):
            turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
            parts.append(Part(number, "part", np.hstack([turn, rng.uniform(-4, 4, (3, 1))])))
    parameters = BuildParameters(
        object_triangles=int(rng.choice([16, 100])), cluster_distance=1.0, cluster_volume=float(rng.choice([0.01, 1.0]))
    )
    folder = tmp_path_factory.mktemp("mixture")
    write_model(folder / "model", meshes, parts)
    check_kinds(build_levels(folder / "model", folder / "store", parameters))
