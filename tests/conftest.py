"""What all tests share."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

# The first call of a kernel compiles it, so no example may be timed.
settings.register_profile("vlod", deadline=None)
settings.load_profile("vlod")


@pytest.fixture(scope="session")
def real_model() -> Callable[[str], Path]:
    """Finds a real model by its path in the folder VLOD_MODELS; skips the test where there is none."""

    def find(name: str) -> Path:
        folder = os.environ.get("VLOD_MODELS")
        if not folder:
            pytest.skip("needs real models: set VLOD_MODELS to their folder")
        path = Path(folder) / name
        if not path.exists():
            pytest.skip(f"{path} is not there")
        return path

    return find
