"""Paths: what is written is read back, bad files are told apart in one line, interpolation passes through the poses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from player.camera.path import CameraPath, read_path, slerp, write_path
from player.camera.view import normalised, rotation_matrix
from player.errors import PathError


def _path(count: int = 6, seed: int = 0) -> CameraPath:
    rng = np.random.default_rng(seed)
    return CameraPath(
        np.cumsum(rng.uniform(0.1, 1, count)), rng.normal(size=(count, 3)), normalised(rng.normal(size=(count, 4)))
    )


def test_a_path_survives_the_file(tmp_path: Path) -> None:
    path = _path()
    write_path(tmp_path / "new" / "p.json", path)
    found = read_path(tmp_path / "new" / "p.json")
    assert np.array_equal(found.times, path.times)
    assert np.array_equal(found.positions, path.positions)
    assert np.allclose(found.orientations, path.orientations)
    assert [file.name for file in (tmp_path / "new").iterdir()] == ["p.json"]


@given(st.integers(1, 8), st.integers(0, 999))
def test_interpolation_passes_through_the_poses(count: int, seed: int) -> None:
    path = _path(count, seed)
    for index in range(count):
        position, orientation = path.at(float(path.times[index]))
        assert np.allclose(position, path.positions[index])
        assert np.allclose(rotation_matrix(orientation), rotation_matrix(path.orientations[index]))
    for time in np.linspace(path.times[0] - 1, path.times[-1] + 1, 40):
        position, orientation = path.at(float(time))
        assert np.isfinite(position).all()
        assert np.isclose(np.linalg.norm(orientation), 1)


def test_interpolation_is_smooth_and_straight_where_the_path_is() -> None:
    path = CameraPath(np.arange(5.0), np.arange(5.0)[:, None] * [1, 2, 0], np.tile([0.0, 0, 0, 1], (5, 1)))
    for time in np.linspace(0, 4, 33):
        assert np.allclose(path.at(float(time))[0], [time, 2 * time, 0])
    assert path.length == pytest.approx(4 * 5**0.5)


def test_resampling_keeps_duration_and_ends() -> None:
    path = _path()
    again = path.resampled(10)
    assert len(again) == round(path.duration * 10) + 1
    assert np.allclose(again.positions[0], path.positions[0])
    assert np.allclose(np.diff(again.times), 0.1)


def test_slerp_goes_the_short_way() -> None:
    a, b = np.array([0.0, 0, 0, 1]), -np.array([0, 0, np.sin(0.5), np.cos(0.5)])
    assert np.allclose(rotation_matrix(slerp(a, b, 0.5))[:2, 0], [np.cos(0.5), np.sin(0.5)])


_GOOD: dict[str, Any] = {
    "format": "vlod-path",
    "version": 1,
    "times": [0, 1],
    "positions": [[0, 0, 0], [1, 0, 0]],
    "orientations": [[0, 0, 0, 1], [0, 0, 0, 1]],
}


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"format": "path"}, "is not a path file"),
        ({"version": 7}, "path version 7"),
        ({"times": [0, 0]}, "times must increase"),
        ({"times": [0]}, "1 times, 2 positions"),
        ({"times": "soon"}, "must be a list"),
        ({"times": [0, None]}, r'"times"\[1\] must be a finite number'),
        ({"times": [0, True]}, r'"times"\[1\] must be a finite number'),
        ({"positions": [[0, 0], [1, 1]]}, r'"positions"\[0\] must be 3 finite numbers'),
        ({"positions": [[0, 0, 0], [float("nan"), 1, 1]]}, r'"positions"\[1\]'),
        ({"positions": None}, "must be a list"),
        ({"orientations": [[0, 0, 0, 1], [0, 0, 0, 3]]}, r"orientations\[1\] is not a unit quaternion"),
        ({"times": [], "positions": [], "orientations": []}, "has no poses"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path: Path, change: dict[str, Any], what: str) -> None:
    file = tmp_path / "bad.json"
    file.write_text(json.dumps(_GOOD | change))
    with pytest.raises(PathError, match=what) as caught:
        read_path(file)
    assert "bad.json" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"\xff\xfe\x00", b"[" * 100_000])
def test_what_is_not_json_is_refused(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "bad.json"
    file.write_bytes(content)
    with pytest.raises(PathError, match=r"bad\.json"):
        read_path(file)


def test_a_missing_file_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(PathError, match="vlod path STORE -o"):
        read_path(tmp_path / "none.json")
    with pytest.raises(PathError, match="cannot be read"):
        read_path(tmp_path)


def test_where_nothing_can_be_written_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(PathError, match="cannot be written"):
        write_path(tmp_path / "file" / "p.json", _path())
