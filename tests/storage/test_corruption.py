"""Any changed byte of a store is found, and no changed byte ever leads to a wrong answer."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from storage import open_store
from storage.base.errors import CorruptStoreError, StoreError
from storage.shards.shards import shard_path
from storage.store import Store
from tests.storage.tiny_store import box_part, make_store, mistold, room_parts


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Store:
    return make_store(tmp_path_factory.mktemp("store"), room_parts()[4:], depth=1, cells_per_shard=4)


def _files(store: Store) -> list[str]:
    return ["manifest.json", *(f"shards/{record.name}" for _, record in store.manifest.shards())]


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_any_flipped_byte_is_found_and_named(sound: Store, tmp_path_factory: pytest.TempPathFactory, data) -> None:
    folder = tmp_path_factory.mktemp("copies") / "copy"
    shutil.copytree(sound.files.url, folder)
    opened = open_store(folder)
    name = data.draw(st.sampled_from(_files(sound)))
    content = bytearray((folder / name).read_bytes())
    content[data.draw(st.integers(0, len(content) - 1))] ^= data.draw(st.integers(1, 255))
    (folder / name).write_bytes(content)

    problems = list(opened.check())
    assert problems
    assert all(problem.file == name and name in str(problem) for problem in problems)
    damaged = []
    try:
        store = open_store(folder)
        for drawable in range(len(store.drawables)):
            for mine, theirs in zip(store.mesh(drawable), sound.mesh(drawable), strict=True):
                assert np.array_equal(mine, theirs)
        for cell in range(len(store.cells)):
            assert np.array_equal(store.vlod(cell), sound.vlod(cell))
    except CorruptStoreError as error:
        damaged.append(error.file)
    assert damaged in ([], [name])
    shutil.rmtree(folder.parent)


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_any_cut_or_lengthened_file_is_found_and_named(
    sound: Store, tmp_path_factory: pytest.TempPathFactory, data
) -> None:
    folder = tmp_path_factory.mktemp("copies") / "copy"
    shutil.copytree(sound.files.url, folder)
    opened = open_store(folder)
    name = data.draw(st.sampled_from(_files(sound)))
    content = (folder / name).read_bytes()
    (folder / name).write_bytes(data.draw(st.sampled_from([content[: len(content) // 2], b"", content + b"\n"])))
    problems = list(opened.check())
    assert problems
    assert all(problem.file == name and name in str(problem) for problem in problems)
    shutil.rmtree(folder.parent)


def test_swapped_shards_are_found(sound: Store, tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(sound.files.url, folder)
    first, second = (folder / name for name in _files(sound)[-2:])
    former = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(former)
    store = open_store(folder)
    assert {problem.file for problem in store.check()} == set(_files(sound)[-2:])


def test_a_missing_file_is_found(sound: Store, tmp_path: Path) -> None:
    for name in _files(sound):
        folder = tmp_path / name.replace("/", "-")
        shutil.copytree(sound.files.url, folder)
        opened = open_store(folder)
        (folder / name).unlink()
        assert {problem.file for problem in opened.check()} == {name}
        if name == "manifest.json":
            with pytest.raises(StoreError):
                open_store(folder)


@pytest.mark.parametrize("which", ["pane", "wall", "both"])
def test_a_wrong_word_about_what_can_be_seen_through_is_found_and_named(tmp_path: Path, which: str) -> None:
    wall = box_part("wall", (0, 0, 0), (2, 0.1, 2))
    pane = box_part("pane", (3, 0, 0), (5, 0.1, 2), colour=(9, 9, 200, 80))
    store = make_store(tmp_path / "s", [wall, pane], depth=1)
    assert list(store.check()) == []
    wrong = {"wall": [0, 1], "pane": [2, 3], "both": [0, 1, 2, 3]}[which]
    told = mistold(store, wrong)
    (problem,) = told.check()
    assert problem.file == shard_path(told.manifest.geometry.tables.name)
    assert f"drawable {wrong[0]} (and {len(wrong) - 1} more like it)" in str(problem)
    said = "cannot be seen through, but the alpha of its vertices is 80 to 80"
    if which != "pane":
        said = "can be seen through, but the alpha of its vertices is 255 to 255"
    assert said in str(problem)


def test_a_newer_version_beside_an_open_store_is_no_problem(tmp_path: Path) -> None:
    opened = make_store(tmp_path, room_parts()[:1], depth=0)
    make_store(tmp_path, room_parts()[:2], depth=0)
    assert not list(opened.check())
