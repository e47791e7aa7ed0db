"""What a task is: a function, its payload, and a key that names the result.

The key is a hash of the stage's name, the stage's code and the payload. A finished key never runs again: retry, a lost
node, a killed driver, resuming and building again after a change are one and the same path.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import importlib
import importlib.metadata
import importlib.util
import json
import shutil
import socket
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from jobs.running.errors import CodeMismatchError
from jobs.running.memory import peak_memory, reset_peak
from jobs.running.workplace import Workplace
from storage.base.typed_json import from_json

RECORD = "record.json"

Json = Mapping[str, Any]

P = TypeVar("P")
Q = TypeVar("Q")


@dataclass(frozen=True)
class Assignment:
    """What a task's function gets."""

    place: Workplace
    out: Path  # a fresh directory to write the result into
    payload: Json  # everything that decides the result
    places: Json  # where inputs lie

    def read(self, payload: type[P], places: type[Q]) -> tuple[P, Q]:
        """The payload and the places as the stage's dataclasses. Raises ValueError for what they are not."""
        return from_json(payload, self.payload, "the payload"), from_json(places, self.places, "the places")


#: The work of a task. It returns a record: small JSON; "shards" in it, a list of [name, bytes], are files of the
#: store's shards folder that belong to the result, "drafts" are those of the folder of drafts.
Work = Callable[[Assignment], dict[str, Any]]


@dataclass(frozen=True)
class Stage:
    """A kind of task."""

    name: str  # also the results' folder
    function: str  # "module:name" of its `Work`
    code: tuple[str, ...]  # modules and packages whose source decides the result
    distributions: tuple[str, ...] = ()  # installed distributions whose version decides the result
    apart: tuple[
        str, ...
    ] = ()  # what that code imports, and what has no say in the result: see `jobs.stages.support.code`
    cure: str | None = None  # what, beside more memory, helps where a task needs too much

    @property
    def version(self) -> str:
        """Hash of the stage's source and of the versions it relies on: changed code never meets old results."""
        return _version(self.code, self.distributions)

    def load(self) -> Work:
        """Imports the stage's function."""
        module, _, name = self.function.partition(":")
        work: Work = getattr(importlib.import_module(module), name)
        return work


@dataclass(frozen=True)
class Task:
    """One piece of work."""

    stage: Stage
    payload: Json  # everything that decides the result, as JSON
    places: Json = field(default_factory=dict)  # where inputs lie, as JSON: not part of the key
    memory: int = 512 << 20  # estimate of what it needs, in bytes

    @functools.cached_property
    def key(self) -> str:
        """32 hex digits: the same for the same content, whatever the order of the payload's names."""
        return content_key(self.stage.name, self.stage.version, self.payload)

    def check_code(self) -> None:
        """Raises CodeMismatchError in a process whose code is not the one that the key was made of."""
        if content_key(self.stage.name, self.stage.version, self.payload) != self.key:
            raise CodeMismatchError(
                f"{socket.gethostname()} runs another version of vLOD, or of what it relies on, than the driver: "
                "install the same on all machines of the cluster, and do not change it during a build"
            )


@dataclass(frozen=True)
class TaskResult:
    """What a finished task says of itself."""

    task: Task
    record: Json  # what the stage's function returned
    seconds: float  # that the work took, when it was done
    core_seconds: float  # of processor time that it took
    peak_memory: int  # of the process that did it, in bytes
    reused: bool  # it was finished before

    @property
    def key(self) -> str:
        """The task's key."""
        return self.task.key


def canonical_json(value: Any) -> str:
    """JSON text that is the same for equal values. Raises TypeError or ValueError for what JSON cannot say."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False, ensure_ascii=True)


def content_key(*parts: Any) -> str:
    """Key of a list of JSON values."""
    return hashlib.blake2b(canonical_json(parts).encode(), digest_size=16).hexdigest()


def content_of_arrays(*arrays: np.ndarray) -> str:
    """Hash of arrays' bytes."""
    digest = hashlib.blake2b(digest_size=16)
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def find_finished(task: Task, place: Workplace) -> TaskResult | None:
    """The result of a task that was finished before, if all of it is still there."""
    return _result_in(place.result(task.stage.name, task.key), task, place)


def run_task(task: Task, place: Workplace) -> TaskResult:
    """Does the work of a task, unless it is finished, and publishes the result under its key.

    May be killed at any moment and run again, here or elsewhere, even twice at once: the first whole result under the
    key stays, and whoever comes later returns that one.
    """
    if finished := find_finished(task, place):
        return finished
    task.check_code()
    stage, key = task.stage.name, task.key
    temporary = place.new_temporary(stage)
    try:
        reset_peak()
        began, core_began = time.perf_counter(), time.process_time()
        record = task.stage.load()(Assignment(place, temporary, task.payload, task.places))
        saved = {
            "record": record,
            "seconds": time.perf_counter() - began,
            "core_seconds": time.process_time() - core_began,
            "peak_memory": peak_memory(),
        }
        (temporary / RECORD).write_text(json.dumps(saved, sort_keys=True))
        place.publish(temporary, stage, key, lambda folder: _result_in(folder, task, place) is not None)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise
    published = find_finished(task, place)
    assert published is not None, "a result that was published is there"
    return dataclasses.replace(published, reused=False)


def _result_in(folder: Path, task: Task, place: Workplace) -> TaskResult | None:
    """The result of a task that lies in a directory, if it is whole and its shards are in the store."""
    try:
        saved = json.loads((folder / RECORD).read_text())
        for root, kind in ((place.store, "shards"), (place.drafts, "drafts")):
            for name, size in saved["record"].get(kind, ()):
                if (root / "shards" / name).stat().st_size != size:
                    return None
        return TaskResult(task, **saved, reused=True)
    except (OSError, ValueError, KeyError, TypeError):
        return None


@functools.lru_cache(maxsize=64)
def _version(code: tuple[str, ...], distributions: tuple[str, ...]) -> str:
    digest = hashlib.blake2b(digest_size=16)
    for module in code:
        for path in _sources(module):
            digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    for distribution in distributions:
        digest.update(f"{distribution}=={importlib.metadata.version(distribution)}\0".encode())
    return digest.hexdigest()


def _sources(module: str) -> list[Path]:
    """The source files of a module, or of a package with all its modules, sorted by path."""
    spec = importlib.util.find_spec(module)
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError(f"no module named {module!r}", name=module)
    origin = Path(spec.origin)
    return sorted(origin.parent.rglob("*.py")) if origin.name == "__init__.py" else [origin]
