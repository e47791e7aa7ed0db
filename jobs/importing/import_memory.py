"""How much memory an import takes, before it is begun: from headers and counts, never from the geometry itself."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from jobs.importing.formats.known import format_of
from jobs.importing.read import find_files
from jobs.importing.reading.content import FileContent
from jobs.importing.reading.resources import Resources


def import_memory(inputs: Sequence[Path]) -> int:
    """Bytes that importing files or folders may take, beside what a process takes anyway: an upper estimate.

    Files are imported one after the other, so the one that takes most counts. A file that cannot be understood counts
    nothing: the import says what is wrong with it. Raises ModelError for inputs that name no model.
    """
    return max(_of_file(file, root) for file, root in find_files(inputs))


def _of_file(file: Path, root: Path) -> int:
    try:
        return format_of(file).memory(file, FileContent(file), Resources(file, root))
    except Exception:  # as many kinds as there are kinds of damage
        return 0
