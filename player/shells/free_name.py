"""Names of files that are not there yet."""

from __future__ import annotations

from pathlib import Path


def free_name(directory: Path, pattern: str) -> Path:
    """The first file of a numbered pattern, such as "picture_{:04d}.png", that is not there; makes the directory."""
    directory.mkdir(parents=True, exist_ok=True)
    number = 1
    while (directory / pattern.format(number)).exists():
        number += 1
    return directory / pattern.format(number)
