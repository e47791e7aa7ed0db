"""Which reader reads which file. Whatever goes wrong in one becomes a ModelError of one line.

Readers of binary glTF and OBJ hand over their meshes one by one, as they are asked for; the others hold a whole file.
"""

from __future__ import annotations

import importlib
import logging
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from jobs.importing.reading.content import Content, FileContent
from jobs.importing.reading.resources import Resources
from jobs.importing.reading.scene import SourceMesh, SourceScene, UnreadMeshes
from storage.base.errors import ModelError

Reader = Callable[[Path, Content, Resources], SourceScene]

#: The module of `jobs.importing` whose `read(file, content, resources)` reads files of an extension.
READERS = {
    ".dae": "dae_file",
    ".glb": "gltf_file",
    ".gltf": "gltf_file",
    ".obj": "obj_file",
    ".off": "off_file",
    ".ply": "ply_file",
    ".stl": "stl_file",
}

KINDS = ", ".join(READERS)

#: Bytes that are looked through at once.
_BLOCK = 1 << 16


def find_files(inputs: Sequence[Path]) -> list[tuple[Path, Path]]:
    """(model file, outermost folder that it may refer to) of files and folders; a folder's files in sorted order.

    Raises ModelError for what does not exist, for a file that is not of a known kind, and for a folder without models.
    """
    if not inputs:
        raise ModelError(f"no input given; name a model file ({KINDS}) or a folder of them")
    found: list[tuple[Path, Path]] = []
    for path in inputs:
        if path.is_dir():
            try:
                files = [file for file in path.rglob("*") if file.suffix.lower() in READERS and file.is_file()]
            except OSError as error:
                raise ModelError(
                    f"{path}: the folder cannot be read ({error.strerror}); check its permissions"
                ) from None
            if not files:
                raise ModelError(f"{path}: the folder holds no model; expected files of these kinds: {KINDS}")
            files.sort(key=lambda file: file.relative_to(path).parts)
            found.extend((file, path) for file in files)
        elif not path.exists():
            raise ModelError(f"{path}: there is no such file or folder; check the path")
        elif not path.is_file():
            raise ModelError(f"{path}: not a regular file; name a model file ({KINDS}) or a folder of them")
        elif path.suffix.lower() not in READERS:
            raise ModelError(f"{path}: not a kind of model that is known; expected one of {KINDS}")
        else:
            found.append((path, path.parent))
    return found


def read_scene(file: Path, root: Path) -> SourceScene:
    """Read one model file; `root` is the outermost folder that it may refer to. Raises ModelError."""
    kind = file.suffix.lower()
    content = FileContent(file)
    with _reading(file):
        if _is_blank(content):
            raise ModelError(f"{file}: the file is empty; export the model again")
        looks = looks_like(content)
    if looks is not None and looks != kind:
        raise ModelError(f"{file}: this is a {looks} file; rename it so that its extension says so")
    reader: Reader = importlib.import_module(f"jobs.importing.formats.{READERS[kind]}").read
    with _reading(file):
        scene = reader(file, content, Resources(file, root))
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
    """Parsers neither warn nor log: what they stumble over is counted, or ends in a ModelError."""
    log = logging.getLogger("trimesh")
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            # older numpys warn where newer ones raise: at text among numbers
            warnings.filterwarnings("error", message="string or file could not be read to its end")
            yield
    finally:
        log.setLevel(level)


def looks_like(content: Content) -> str | None:
    """The extension that the first bytes speak for, None if they speak for none in particular."""
    start = content.part(0, 4096)
    if start.startswith(b"glTF"):
        return ".glb"
    if start.startswith((b"ply\n", b"ply\r")):
        return ".ply"
    if start.startswith((b"OFF\n", b"OFF\r", b"COFF\n", b"COFF\r")):
        return ".off"
    head = start.lstrip(b"\xef\xbb\xbf \t\r\n")
    if head.startswith(b"<") and b"<COLLADA" in head:
        return ".dae"
    if head.startswith(b"{") and b'"asset"' in content.part(0, content.size):
        return ".gltf"
    return None


def _one_line(error: BaseException) -> str:
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 160 else f"{text[:157]}..."
