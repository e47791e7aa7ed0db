"""All that the import must know of a kind of model file."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from jobs.importing.reading.content import Content
from jobs.importing.reading.needs import text_needs
from jobs.importing.reading.resources import Resources
from jobs.importing.reading.source_scene import SourceScene


def _may_be_anything(_content: Content) -> bool:
    return False


def _names_none(_file: Path, _content: Content, _resources: Resources) -> Iterable[str]:
    return ()


@dataclass(frozen=True)
class Format:
    """A kind of model file. Its reader's module holds it, and `jobs.importing.formats.known` lists it.

    The functions get a file's path, its bytes, and the files beside it. On damaged files they may raise anything: an
    import makes one clear ModelError of it, and whoever only looks at a file leaves it to the import.
    """

    #: Lower case, with the dot.
    extensions: tuple[str, ...]

    #: Reads a file. Raises ModelError, or whatever its parsers raise.
    read: Callable[[Path, Content, Resources], SourceScene]

    #: Whether the first bytes of any file speak for this format and no other.
    sniff: Callable[[Content], bool] = _may_be_anything

    #: References to the other files that a file names, as it writes them; an import is repeated when one changes.
    named_files: Callable[[Path, Content, Resources], Iterable[str]] = _names_none

    #: Bytes that reading a file may take: an upper estimate, from headers and counts.
    memory: Callable[[Path, Content, Resources], int] = text_needs
