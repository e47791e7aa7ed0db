"""What several tests of the job build on."""

from __future__ import annotations

from pathlib import Path

import pytest

from jobs.scenes import write_scene


@pytest.fixture(scope="session")
def small_plant(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A demo plant of 20,000 triangles."""
    path = tmp_path_factory.mktemp("model") / "plant.glb"
    write_scene("plant", path, 20_000, 0)
    return path
