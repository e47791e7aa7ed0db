"""The models that benchmarks name: demo scenes with a size, and files below VLOD_MODELS."""

from __future__ import annotations

import os
from pathlib import Path

from jobs.scenes import write_scene


def model_file(name: str, folder: Path) -> Path:
    """The file of a model: a demo scene with its number of triangles (plant:1000000), made in `folder`, or a path.

    Relative paths are looked up below the environment variable VLOD_MODELS, if it is set. Raises FileNotFoundError.
    """
    scene, _, size = name.partition(":")
    if size:
        file = folder / f"{scene}.glb"
        write_scene(scene, file, int(size), 0)
        return file
    file = Path(os.environ.get("VLOD_MODELS", ".")) / name
    if not file.exists():
        raise FileNotFoundError(f"{file}: no such model; set VLOD_MODELS to the folder of the real ones")
    return file
