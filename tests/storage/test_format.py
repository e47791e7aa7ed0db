"""Reads a store by FORMAT.md alone, without any code of storage."""

import hashlib
import json
import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard

from storage.store import Store
from tests.storage.tiny_store import make_store, room_parts


def _shard(root: Path, shard: dict[str, Any]) -> list[tuple[int, bytes]]:
    content = (root / "shards" / shard["name"]).read_bytes()
    assert len(content) == shard["bytes"]
    assert hashlib.sha256(content).hexdigest()[:32] == shard["name"]
    assert content[:8] == b"vLODshd\x01"
    assert content[-8:] == b"\x01dhsDOLv"
    (length,) = struct.unpack("<Q", content[-32:-24])
    index = content[-32 - length : -32]
    assert hashlib.blake2b(index, digest_size=16).digest() == content[-24:-8]
    frames = []
    for kind, offset, count, checksum in struct.iter_unpack("<IQQQ", index):
        payload = content[offset : offset + count]
        assert struct.unpack("<Q", hashlib.blake2b(payload, digest_size=8).digest()) == (checksum,)
        frames.append((kind, payload))
    return frames


def _table(payload: bytes) -> np.ndarray:
    (length,) = struct.unpack("<I", payload[:4])
    head = json.loads(payload[4 : 4 + length])
    dtype = np.dtype([(name, kind, tuple(shape)) for name, kind, shape in head["fields"]])
    columns = np.frombuffer(zstandard.decompress(payload[4 + length :]), np.uint8)
    return np.ascontiguousarray(columns.reshape(dtype.itemsize, head["rows"]).T).view(dtype).ravel()


def _lists(payload: bytes) -> list[list[int]]:
    count, total = struct.unpack("<II", payload[:8])
    numbers, value, shift = [], 0, 0
    for byte in zstandard.decompress(payload[8:]):
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            numbers.append(value)
            value, shift = 0, 0
    assert len(numbers) == total
    lists, at = [], count
    for length in numbers[:count]:
        ids: list[int] = []
        for gap in numbers[at : at + length]:
            ids.append(gap if not ids else ids[-1] + 1 + gap)
        lists.append(ids)
        at += length
    return lists


def _apart(one: np.void, other: np.void) -> int:
    """The squared distance of two cells' centres, in half edges of the finest cells there can be."""
    centres = []
    for row in (one, other):
        digits = [int(row["key"]) >> (3 * level) & 7 for level in range(int(row["depth"]))]
        place = [sum((digit >> axis & 1) << level for level, digit in enumerate(digits)) for axis in range(3)]
        centres.append([(2 * at + 1) << (20 - int(row["depth"])) for at in place])
    return sum((a - b) ** 2 for a, b in zip(*centres, strict=True))


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    def visible(geometry, cell, cut):
        return cut[np.random.default_rng(int(cell["key"])).random(len(cut)) < 0.6]

    return make_store(tmp_path_factory.mktemp("store"), room_parts(), visible=visible, codecs=["gap-varint-zstd"])


def test_the_modules_that_it_names_are_there() -> None:
    package = Path(__file__).parents[2] / "storage"
    named = re.findall(r"`([a-z_/]+\.py|[a-z_/]+/)`", (package / "FORMAT.md").read_text())
    own = [name for name in named if name not in ("storage/", "shards/", "work/")]
    assert len(own) > 8
    assert [name for name in own if not (package / name).exists()] == []


def test_the_manifest(store: Store) -> None:
    root = Path(store.files.url)
    data = (root / "manifest.json").read_bytes()
    assert (root / "versions" / "1.json").read_bytes() == data
    content = json.loads(data)
    assert json.dumps(content, sort_keys=True, indent=1).encode() + b"\n" == data
    checksum = content.pop("checksum")
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":")).encode()
    assert hashlib.blake2b(canonical, digest_size=16).hexdigest() == checksum
    assert content["format"] == 6
    assert content["requires"] == []
    assert set(content["model"]) == {"digest", "triangles", "lo", "hi", "origin", "up", "unit_in_metres"}
    assert set(content["geometry"]) == {"grid_step", "tables", "shards", "counts"}
    assert set(content["cells"]) == {"octree_lo", "octree_size", "table", "shards", "counts"}
    assert {"format", "version", "requires", "model", "parameters", "pixel_angle", "geometry", "cells"} == set(content)


def test_tables(store: Store) -> None:
    content = json.loads((Path(store.files.url) / "manifest.json").read_bytes())
    frames = _shard(Path(store.files.url), content["geometry"]["tables"])
    expected = [store.parts, store.instances, store.geometry, store.packs, store.nodes, store.drawables]
    for (kind, payload), table in zip(frames[:6], expected, strict=True):
        assert kind == 1
        assert _table(payload).tobytes() == table.tobytes()
    assert frames[6][0] == 2
    assert tuple(json.loads(zstandard.decompress(frames[6][1]))) == store.part_names


def test_cells(store: Store) -> None:
    root = Path(store.files.url)
    cells = json.loads((root / "manifest.json").read_bytes())["cells"]
    table, groups = (_table(payload) for _, payload in _shard(root, cells["table"]))
    assert table.tobytes() == store.cells.tobytes()
    first, sizes = 0, groups["cells"].tolist()
    for shard in cells["shards"]:
        assert shard["codec"] == "gap-varint-zstd"
        end = first + shard["cells"]
        for kind, payload in _shard(root, shard):
            assert kind == 5
            members = [cell for cell in range(first, first + sizes[0]) if table["computed"][cell]]
            first += sizes.pop(0)
            lists = _lists(payload)
            assert len(lists) == max(2 * len(members) - 1, 0)
            sets: list[set[int]] = []
            for number, cell in enumerate(members):
                if number == 0:
                    sets.append(set(lists[0]))
                else:
                    before = min(range(number), key=lambda k: (_apart(table[members[k]], table[cell]), -k))
                    added, dropped = set(lists[2 * number - 1]), set(lists[2 * number])
                    assert not added & sets[before]
                    assert dropped <= sets[before]
                    sets.append((sets[before] | added) - dropped)
                assert sorted(sets[number]) == store.vlod(cell).tolist()
        assert first == end
    assert sizes == []
    lo, size = np.array(cells["octree_lo"]), cells["octree_size"]
    for cell in store.cells:
        digits = [int(cell["key"]) >> (3 * level) & 7 for level in range(int(cell["depth"]))]
        place = np.array([sum((digit >> axis & 1) << level for level, digit in enumerate(digits)) for axis in range(3)])
        assert np.array_equal(cell["lo"], lo + size * (place / 2 ** int(cell["depth"])))
        assert np.array_equal(cell["hi"], lo + size * ((place + 1) / 2 ** int(cell["depth"])))


def test_positions_and_source_faces(store: Store) -> None:
    """The streams' sizes, and the positions of each pack as a set."""
    root = Path(store.files.url)
    shards = [_shard(root, entry) for entry in json.loads((root / "manifest.json").read_bytes())["geometry"]["shards"]]
    for number, row in enumerate(store.packs):
        kind, payload = shards[row["shard"]][row["frame"]]
        assert kind == 3
        content = zstandard.decompress(payload)
        meshes, places, vertices, triangles, more, named, wedges = struct.unpack("<7I", content[:28])
        sizes = [28, 12 * meshes, triangles, more, 4 * named, wedges, 12 * places, 4 * vertices, 4 * vertices]
        assert len(content) == sum(sizes)
        assert (row["vertices"], row["triangles"]) == (vertices, triangles)
        decoded = store.pack(number)
        planes = np.frombuffer(content[-4 * vertices :], np.uint8).reshape(4, -1)
        assert np.array_equal(np.cumsum(planes, axis=1, dtype=np.uint8).T, decoded.colours)
        assert len(np.unique(decoded.positions, axis=0)) <= places
        if row["source_frame"] >= 0:
            kind, payload = shards[row["shard"]][row["source_frame"]]
            assert kind == 4
            planes = np.frombuffer(zstandard.decompress(payload), np.uint8).reshape(2, 4, -1)
            zigzag = planes.transpose(2, 0, 1).copy().view("<u4")[:, :, 0].astype(np.int64)
            faces = np.cumsum((zigzag >> 1) ^ -(zigzag & 1), axis=0).astype(np.uint32)
            assert len(faces) == triangles
            for drawable in np.flatnonzero(store.drawables["level"] == 0).tolist():
                place = store.geometry[store.drawables[drawable]["geometry"]]
                if place["pack"] == number:
                    start = int(place["triangle_start"])
                    expected = faces[start : start + int(place["triangles"]), 1]
                    assert np.array_equal(store.source_faces(drawable)[1], expected)
