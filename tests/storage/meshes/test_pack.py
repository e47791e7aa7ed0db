import numpy as np
import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st

from storage.base.errors import CorruptStoreError
from storage.meshes.normals import LIMIT, from_octahedral, to_octahedral
from storage.meshes.pack import MeshArrays, ordered, pack, pack_source_faces, unpack, unpack_source_faces
from tests.storage.strategies import meshes
from tests.storage.tiny_store import box_part


def _soup(mesh: MeshArrays) -> list[tuple]:
    """What a mesh's triangles look like, whatever their order and their first corners."""
    folded = to_octahedral(mesh.normals)
    faces = np.zeros((len(mesh.triangles), 2), np.uint32) if mesh.source_faces is None else mesh.source_faces
    rows = []
    for triangle, face in zip(mesh.triangles.tolist(), faces.tolist(), strict=True):
        corners = [
            (*mesh.positions[v].tolist(), *from_octahedral(folded[v : v + 1])[0].tolist(), *mesh.colours[v].tolist())
            for v in triangle
        ]
        first = min(range(3), key=lambda k: corners[k:] + corners[:k])
        rows.append((*corners[first:], *corners[:first], face))
    return sorted(rows)


@given(meshes())
def test_order_changes_nothing_but_the_order(mesh: MeshArrays) -> None:
    result = ordered(mesh)
    assert _soup(result) == _soup(mesh)
    assert result.scale == mesh.scale
    assert np.array_equal(np.unique(result.triangles), np.arange(len(result.positions)))


@given(st.lists(meshes(), max_size=5))
def test_a_pack_gives_back_the_very_same_arrays(given: list[MeshArrays]) -> None:
    bunch = [ordered(mesh) for mesh in given]
    decoded = unpack(pack(bunch))
    vertex = triangle = 0
    for mesh in bunch:
        vertices = slice(vertex, vertex + len(mesh.positions))
        triangles = slice(triangle, triangle + len(mesh.triangles))
        assert np.array_equal(decoded.positions[vertices], mesh.positions)
        assert np.array_equal(from_octahedral(decoded.folded[vertices].astype(np.int32)), mesh.normals)
        assert np.array_equal(decoded.colours[vertices], mesh.colours)
        assert np.array_equal(decoded.triangles[triangles], mesh.triangles)
        vertex, triangle = vertices.stop, triangles.stop
    assert (len(decoded.positions), len(decoded.triangles)) == (vertex, triangle)
    assert not any(array.flags.writeable for array in decoded)


@given(st.lists(meshes(), max_size=5))
def test_source_faces_come_back(given: list[MeshArrays]) -> None:
    bunch = [ordered(mesh) for mesh in given]
    expected = [
        np.zeros((len(mesh.triangles), 2), np.uint32) if mesh.source_faces is None else mesh.source_faces
        for mesh in bunch
    ]
    found = unpack_source_faces(pack_source_faces(bunch))
    assert np.array_equal(found, np.concatenate([np.zeros((0, 2), np.uint32), *expected]))


@given(st.integers(0, 2**32 - 1))
def test_normals_keep_their_direction(seed: int) -> None:
    normals = np.random.default_rng(seed).normal(size=(500, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    decoded = from_octahedral(to_octahedral(normals.astype(np.float32)))
    assert np.allclose(np.linalg.norm(decoded, axis=1), 1, atol=1e-6)
    assert (np.sum(decoded * normals, axis=1) > np.cos(np.radians(0.25))).all()


def test_octahedral_normals_are_stable() -> None:
    line = np.arange(-LIMIT, LIMIT + 1, 7, dtype=np.int32)
    edge = np.array([-LIMIT, -1, 0, 1, LIMIT], np.int32)
    folded = np.stack(np.meshgrid(np.union1d(line, edge), np.union1d(line, edge)), axis=-1).reshape(-1, 2)
    folded = folded.astype(np.int32)
    normals = from_octahedral(folded)
    assert np.array_equal(from_octahedral(to_octahedral(normals)), normals)


def test_axes_are_exact() -> None:
    axes = np.concatenate([np.eye(3), -np.eye(3)]).astype(np.float32)
    assert np.array_equal(from_octahedral(to_octahedral(axes)), axes)


def test_vertices_that_agree_become_one() -> None:
    positions = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [9, 0, 0], [9, 9, 0], [0, 9, 0]], np.int32)
    mesh = MeshArrays(
        positions,
        np.array([[0, 1, 2], [3, 4, 5]], np.uint32),
        np.tile(np.array([0, 0, 1], np.float32), (6, 1)),
        np.full((6, 4), 255, np.uint8),
        np.array([[0, 7], [0, 8]], np.uint32),
        0.5,
    )
    assert len(ordered(mesh).positions) == 4


def test_boxes_take_few_bytes() -> None:
    """A regular closed surface: below one byte a triangle, where its plain arrays have 23."""
    part = box_part("box", (0, 0, 0), (1, 2, 3), segments=(24,))
    positions, triangles = part.levels[0]
    integers = np.rint(positions * 2**20).astype(np.int32)
    colours = np.tile(np.array(part.colour, np.uint8), (len(positions), 1))
    mesh = ordered(MeshArrays(integers, triangles, part.normals[0].astype(np.float32), colours, None, 2.0**-20))
    assert len(pack([mesh])) < len(triangles)


def test_arrays_that_do_not_fit_are_refused() -> None:
    mesh = MeshArrays(
        np.zeros((3, 3), np.int32),
        np.array([[0, 1, 2]], np.uint32),
        np.tile(np.array([0, 0, 1], np.float32), (3, 1)),
        np.zeros((3, 4), np.uint8),
        None,
        1.0,
    )
    with pytest.raises(ValueError, match="2 normals"):
        ordered(mesh._replace(normals=mesh.normals[:2]))
    with pytest.raises(ValueError, match="names vertex 3 of 3"):
        ordered(mesh._replace(triangles=np.array([[0, 1, 3]], np.uint32)))
    with pytest.raises(ValueError, match=r"source faces \(2, 2\) for 1"):
        ordered(mesh._replace(source_faces=np.zeros((2, 2), np.uint32)))
    unordered = mesh._replace(
        positions=np.arange(9, dtype=np.int32).reshape(3, 3), triangles=np.array([[2, 1, 0]], np.uint32)
    )
    with pytest.raises(ValueError, match="brought into order"):
        pack([unordered])


@given(st.data())
def test_senseless_bytes_are_refused_and_never_crash(data: st.DataObject) -> None:
    bunch = [ordered(mesh) for mesh in data.draw(st.lists(meshes(), min_size=1, max_size=3))]
    content = bytearray(zstandard.ZstdDecompressor().decompress(pack(bunch)))
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    try:
        decoded = unpack(zstandard.ZstdCompressor().compress(bytes(content)))
    except CorruptStoreError:
        return
    assert len(decoded.positions) == len(decoded.folded) == len(decoded.colours)


def test_bytes_that_are_no_pack() -> None:
    for data in (b"", b"nonsense", zstandard.ZstdCompressor().compress(b"1234")):
        with pytest.raises(CorruptStoreError, match="cannot be decoded"):
            unpack(data)
    with pytest.raises(CorruptStoreError, match="cannot be decoded"):
        unpack_source_faces(b"nonsense")
