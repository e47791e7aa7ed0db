"""Which files are read, and each by its reader. Whatever goes wrong in one becomes a ModelError of one line.

Readers of binary glTF and OBJ hand over their meshes one by one, as they are asked for; the others hold a whole file.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from jobs.importing.formats.known import checked_file, extensions, format_of, kinds, sniffed
from jobs.importing.reading.content import Content, FileContent
from jobs.importing.reading.resources import Resources
from jobs.importing.reading.source_scene import SourceMesh, SourceScene, UnreadMeshes
from storage.base.errors import ModelError

#: Bytes that are looked through at once.
_BLOCK = 1 << 16


def find_files(inputs: Sequence[Path]) -> list[tuple[Path, Path]]:
    """(model file, outermost folder that it may refer to) of files and folders; a folder's files in sorted order.

    Raises ModelError for what does not exist, for a file that is not of a known kind, and for a folder without models.
    """
    if not inputs:
        raise ModelError(f"no input given; name a model file ({kinds()}) or a folder of them")
    known = extensions()
    found: list[tuple[Path, Path]] = []
    for path in inputs:
        if path.is_dir():
            try:
                files = [file for file in path.rglob("*") if file.suffix.lower() in known and file.is_file()]
            except OSError as error:
                raise ModelError(
                    f"{path}: the folder cannot be read ({error.strerror}); check its permissions"
                ) from None
            if not files:
                raise ModelError(f"{path}: the folder holds no model; expected files of these kinds: {kinds()}")
            files.sort(key=lambda file: file.relative_to(path).parts)
            found.extend((file, path) for file in files)
        else:
            format_of(checked_file(path))
            found.append((path, path.parent))
    return found


def read_scene(file: Path, root: Path) -> SourceScene:
    """Read one model file; `root` is the outermost folder that it may refer to. Raises ModelError."""
    content = FileContent(file)
    with _reading(file):
        if _is_blank(content):
            raise ModelError(f"{file}: the file is empty; export the model again")
        looks = sniffed(content)
    known = format_of(file)
    if looks is not None and looks != known:
        raise ModelError(f"{file}: this is a {looks.extensions[0]} file; rename it so that its extension says so")
    with _reading(file):
        scene = known.read(file, content, Resources(file, root))
    if not scene.meshes or not scene.nodes:
        raise ModelError(f"{file}: the file holds no triangles; export the model again with its surfaces")
    meshes = scene.meshes

    def read_mesh(number: int) -> SourceMesh:
        with _reading(file):
            return meshes[number]

    scene.meshes = UnreadMeshes(len(meshes), read_mesh)
    return scene


@contextmanager
def _reading(file: Path) -> Iterator[None]:
    """What goes wrong while a file is read becomes a ModelError."""
    kind = file.suffix.lower()
    try:
        with _quiet():
            yield
    except ModelError:
        raise
    except OSError as error:
        raise ModelError(
            f"{file}: cannot be read ({error.strerror or error}); check the file and its permissions"
        ) from None
    except MemoryError:
        raise ModelError(f"{file}: not enough memory to read the file; use a machine with more") from None
    except RecursionError:
        raise ModelError(f"{file}: nested too deeply to be a {kind} model; export the model again") from None
    except Exception as error:  # parsers raise almost anything on damaged bytes
        raise ModelError(
            f"{file}: cannot be read as {kind}: {_one_line(error)}; the file is damaged or cut short, export it again"
        ) from error


def _is_blank(content: Content) -> bool:
    """Whether nothing but blanks and zeros is there."""
    starts = range(0, content.size, _BLOCK)
    return not any(content.part(start, start + _BLOCK).strip(b"\0 \t\r\n") for start in starts)


@contextmanager
def _quiet() -> Iterator[None]:
    """Parsers do not warn: what they stumble over is counted, or ends in a ModelError."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        # older numpys warn where newer ones raise: at text among numbers
        warnings.filterwarnings("error", message="string or file could not be read to its end")
        yield


def _one_line(error: BaseException) -> str:
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 160 else f"{text[:157]}..."
