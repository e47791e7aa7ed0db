"""Shards of a version made again from the model: by a build with the version's parameters, in a place beside the store.

The sound shards of the store are linked into that place, so that a build with the store's work directory makes none but
those that lack; without one it makes all. The same model, parameters and code give the same bytes, and so the same
names. The store itself changes only when a shard is there, whole, and then in one move.
"""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

from jobs.parameters import BuildParameters
from jobs.pipeline import build, run_stages
from jobs.running.choose_executor import AUTO_RAY_BYTES, choose_executor
from jobs.running.executors import Executor
from jobs.running.memory import MemoryWatch
from jobs.running.run import Run
from jobs.running.workplace import Workplace
from jobs.stages import import_model
from jobs.stages.support.build_state import BuildState
from jobs.upkeep.folder import flush
from storage.base.errors import CorruptStoreError
from storage.base.progress import Progress
from storage.base.temporary import temporary_path
from storage.base.typed_json import from_json
from storage.shards.manifest import FILE, Manifest
from storage.shards.shards import FOLDER, shard_path


def rebuild(
    store: Path,
    work: Path,
    manifest: Manifest,
    bad: Collection[str],
    model: Sequence[Path],
    workers: int | None,
    memory: int,
    progress: Progress,
) -> list[str]:
    """Makes shards of a version again; returns the names of those that came out and are in the store now.

    work: directory with results of the store's builds, which may be missing; manifest: of the version; bad: names of
    the shards that are bad or missing; model: files or folders; workers: tasks at once, None for all cores; memory:
    that a task may need, in bytes.
    Nothing is made of another model than the version's. Raises ModelError, ParameterError, JobError.
    """
    try:
        parameters = from_json(BuildParameters, dict(manifest.parameters), "the parameters")
    except ValueError as error:
        raise CorruptStoreError(f"{store}: version {manifest.version} cannot be built again: {error}", FILE) from error
    wanted = sorted({shard.name for _, shard in manifest.shards()} & set(bad))
    with _beside(store, bad) as place, contextlib.closing(_executor(model, workers)) as executor:
        workplace = Workplace(work.absolute() if work.is_dir() else place / "work", place)
        state = BuildState(workplace, model, parameters)
        if _digest(workplace, state, executor, memory, progress) != manifest.model.digest:
            return []
        build(model, place, parameters, executor, progress, workplace.work, memory)
        made = [name for name in wanted if (place / shard_path(name)).is_file()]
        for name in made:
            (place / shard_path(name)).replace(store / shard_path(name))
        flush(store / FOLDER)
    return made


def _executor(model: Sequence[Path], workers: int | None) -> Executor:
    from jobs.importing.inputs import total_bytes

    return choose_executor("auto", workers, None, total_bytes(model, AUTO_RAY_BYTES))


@contextlib.contextmanager
def _beside(store: Path, bad: Collection[str]) -> Iterator[Path]:
    """A place for a build that has all of a store's shards but the bad ones, which goes afterwards."""
    place = temporary_path(store.absolute())
    (place / FOLDER).mkdir(parents=True)
    (store / FOLDER).mkdir(exist_ok=True)
    try:
        for path in (store / FOLDER).iterdir():
            if path.name not in bad:
                with contextlib.suppress(OSError):  # what cannot be linked is made again
                    (place / FOLDER / path.name).hardlink_to(path)
        yield place
    finally:
        shutil.rmtree(place, ignore_errors=True)


def _digest(place: Workplace, state: BuildState, executor: Executor, memory: int, progress: Progress) -> str:
    """The digest of the model as it is imported; the build that follows finds the import done."""
    with place.made(), place.locked(), MemoryWatch() as watch:
        run_stages((import_model,), Run(place, executor, progress, watch, memory), state)
        return str(state.one(import_model.STAGE).record["model"]["digest"])
