"""The other files that a model file names: buffers, material libraries, textures.

Only files inside the model's own folder are ever read; nothing is fetched from a network. A reference that leads
elsewhere (an absolute path of the machine that exported the model, say) is looked up by the end of its path inside the
folder.
"""

from __future__ import annotations

import base64
import binascii
import os
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
        for name in dict.fromkeys((reference, unquote(reference))):
            steps = [step for step in _plain(name).split("/") if step not in ("", ".")]
            if not steps or "\0" in name:
                continue
            direct = _resolved(self._folder, steps)
            if not _absolute(name) and direct.is_relative_to(self._root) and _is_file(direct):
                return direct
            inside = [step for step in steps if step != ".." and not step.endswith(":")]
            for start in range(len(inside)):
                for base in dict.fromkeys((self._folder, self._root)):
                    if _is_file(base.joinpath(*inside[start:])):
                        return base.joinpath(*inside[start:])
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
