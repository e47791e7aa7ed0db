"""Which files a model consists of, and a key of their content.

A file brings along those that it names (see `Format.named_files`), found as the import finds them; a folder brings
along everything in it. Files that are named but missing are the import's to report.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path

from jobs.importing.formats.known import checked_file, format_of
from jobs.importing.reading.content import Content, FileContent, HashedContent
from jobs.importing.reading.resources import Resources
from storage.base.errors import ModelError


def content_of(inputs: Sequence[Path]) -> list[list[str]]:
    """Name and hash of every file of a model, in a fixed order: what an import's key is made of.

    Names count from the inputs, so a model that is moved as a whole keeps its key. Each file is read once. Raises
    ModelError for a file or folder that is missing or cannot be read.
    """
    entries = []
    for number, path in enumerate(inputs):
        base = path if path.is_dir() else path.parent
        content = HashedContent(FileContent(path))
        for file in _files(path, content):
            name = file.relative_to(base).as_posix() if file.is_relative_to(base) else file.name
            digest = _digest(file, content if file == path else HashedContent(FileContent(file)))
            entries.append([f"{number}/{name}", digest])
    return entries


def model_files(path: Path) -> list[Path]:
    """All files that belong to an input file or folder, sorted. Raises ModelError if it is missing."""
    return _files(path, FileContent(path))


def total_bytes(inputs: Sequence[Path], enough: int) -> int:
    """Size of all files of a model, in bytes; or any number above `enough` if it is above.

    Only a model that may stay below is looked through for the files that it names. Raises ModelError for what is
    missing.
    """
    alone = [file for path in inputs for file in (_files_below(path) if path.is_dir() else [checked_file(path)])]
    size = sum(file.stat().st_size for file in alone)
    if size > enough:
        return size
    return sum(file.stat().st_size for path in inputs for file in model_files(path))


def _files(path: Path, content: Content) -> list[Path]:
    """The files of an input, sorted; what a file names is found by reading its `content`."""
    if path.is_dir():
        return _files_below(path)
    resources = Resources(path)
    found = {checked_file(path)}
    with contextlib.suppress(Exception):  # the import tells of damage; what was found before it counts
        for reference in format_of(path).named_files(path, content, resources):
            file = resources.find(reference)
            if file is not None:
                found.add(file)
    return sorted(found)


def _files_below(folder: Path) -> list[Path]:
    return sorted(file for file in folder.rglob("*") if file.is_file())


def _digest(file: Path, content: HashedContent) -> str:
    try:
        return content.digest()
    except OSError as error:
        raise ModelError(f"{file}: cannot be read ({error.strerror}); check its permissions") from None
