"""The other files that a model file names: buffers, material libraries, textures.

Only files inside the model's own folder are ever read; nothing is fetched from a network. A reference that leads
elsewhere (an absolute path of the machine that exported the model, say) is looked up by the end of its path inside the
folder. Where no file bears a name, the one that bears it in other letters (capital or small, an accent composed or not)
is taken, if it is the only one; names that are not UTF-8 are tried as their bytes, and as Western European text.
"""

from __future__ import annotations

import base64
import binascii
import os
import unicodedata
from collections.abc import Callable, Iterator
from pathlib import Path, PurePosixPath
from urllib.parse import unquote, unquote_to_bytes

from jobs.importing.reading.content import Content, FileContent, HeldContent


class Resources:
    """Files beside a model file."""

    def __init__(self, file: Path, root: Path | None = None) -> None:
        """Of the model file `file`; `root` is the outermost folder that may be read, by default the file's own."""
        self._folder = file.parent.absolute()
        self._root = (root or file.parent).absolute()

    def read(self, reference: str) -> bytes | None:
        """The content that a URI or path stands for; None if it is missing, outside, remote or cannot be read."""
        content = self.open(reference)
        try:
            return None if content is None else content.part(0, content.size)
        except OSError:
            return None

    def open(self, reference: str) -> Content | None:
        """The same, to be read in parts."""
        if reference.startswith("data:"):
            data = _inline(reference)
            return None if data is None else HeldContent(data)
        path = self.find(reference)
        return FileContent(path) if path is not None and os.access(path, os.R_OK) else None

    def find(self, reference: str) -> Path | None:
        """The file that a URI or path stands for, None if there is none in the folder."""
        spellings = [name for name in dict.fromkeys(_spellings(reference)) if "\0" not in name]
        for below in (_exactly, _in_other_letters):
            for name in spellings:
                found = self._found(name, below)
                if found is not None:
                    return found
        return None

    def _found(self, name: str, below: Callable[[Path, list[str]], Path | None]) -> Path | None:
        """The file of that name in the folder; `below` finds one by its folder and the steps from there."""
        steps = [step for step in _plain(name).split("/") if step not in ("", ".")]
        if not steps:
            return None
        direct = _resolved(self._folder, steps)
        if not _absolute(name) and direct.is_relative_to(self._root):
            found = below(self._root, list(direct.relative_to(self._root).parts))
            if found is not None:
                return found
        inside = [step for step in steps if step != ".." and not step.endswith(":")]
        for start in range(len(inside)):
            for base in dict.fromkeys((self._folder, self._root)):
                found = below(base, inside[start:])
                if found is not None:
                    return found
        return None


def _plain(name: str) -> str:
    return name.replace("\\", "/").strip()


def _absolute(name: str) -> bool:
    plain = _plain(name)
    return PurePosixPath(plain).is_absolute() or ":" in plain.split("/", maxsplit=1)[0]


def _resolved(folder: Path, steps: list[str]) -> Path:
    """`folder` and steps, with ".." taken literally: no symbolic link is followed here."""
    path = folder
    for step in steps:
        path = path.parent if step == ".." else path / step
    return path


def _spellings(reference: str) -> Iterator[str]:
    """What a reference may mean: itself, a URI, a name whose bytes are Western European text."""
    for name in (reference, unquote(reference, errors="surrogateescape")):
        yield name
        if any("\udc80" <= letter <= "\udcff" for letter in name):
            yield name.encode("utf-8", "surrogateescape").decode("cp1252", "replace")


def _exactly(folder: Path, steps: list[str]) -> Path | None:
    path = folder.joinpath(*steps)
    return path if _is_file(path) else None


def _in_other_letters(folder: Path, steps: list[str]) -> Path | None:
    """The one file whose path differs from `steps` in capitals and accents only; None if there is none, or several."""
    for step in steps:
        direct = folder / step
        if not _exists(direct):
            try:
                names = os.listdir(folder)  # noqa: PTH208  names alone, of a folder that may be no folder
            except (OSError, ValueError):
                return None
            same = [name for name in names if _letters(name) == _letters(step)]
            if len(same) != 1:
                return None
            direct = folder / same[0]
        folder = direct
    return folder if _is_file(folder) else None


def _letters(name: str) -> str:
    return unicodedata.normalize("NFC", name).casefold()


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _inline(uri: str) -> bytes | None:
    head, comma, data = uri.partition(",")
    if not comma:
        return None
    if not head.endswith(";base64"):
        return unquote_to_bytes(data)
    try:
        return base64.b64decode(unquote(data), validate=False)
    except (binascii.Error, ValueError):
        return None
