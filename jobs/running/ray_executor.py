"""Running tasks on Ray: on a running cluster, or on one that is started on this machine. Only this file knows Ray.

A task's bulk data goes through the work directory and the store, which all workers must see under the same paths; what
travels through Ray is a small task and a small record.
"""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import socket
import threading
from collections.abc import Generator, Iterable
from dataclasses import dataclass
from typing import Any

from jobs.running.compiling_signs import seen, shown
from jobs.running.errors import ClusterError, MemoryLimitError, WorkerLostError
from jobs.running.executors import Backlog, FollowersOf, no_followers, run_backlog
from jobs.running.tasks import Task, TaskResult, run_task
from jobs.running.workplace import Workplace
from storage.base.compiling import announce

#: Attempts at a task whose worker or node died; spot nodes vanish, but a task that kills workers must end.
ATTEMPTS = 4

#: Times that a task which ran out of memory is tried again, each time with twice the memory set aside for it.
MEMORY_ATTEMPTS = 2

#: Ray's shared memory on this machine, in bytes: results are small records, so the smallest that it accepts will do.
OBJECT_STORE = 80 << 20

#: How long the head node of a cluster may take to answer, in seconds.
CONNECT_SECONDS = 10.0

#: How often to look whether a task is late because its worker compiles, in seconds.
LOOK_SECONDS = 1.0

#: Settings of a Ray that is started here; what the user has set stays.
_ENVIRONMENT = {
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",  # leave CUDA_VISIBLE_DEVICES alone, and do not warn about it
    "RAY_ENABLE_UV_RUN_RUNTIME_ENV": "0",  # `uv run` would package and install the environment for every worker
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_DEDUP_LOGS": "0",
}


@dataclass
class _Attempt:
    task: Task
    memory: int  # set aside for it, in bytes
    lost: int = 0  # workers that died of it
    starved: int = 0  # times it ran out of memory


class RayExecutor:
    """Runs tasks on Ray workers, one core each."""

    name = "ray"

    def __init__(self, workers: int | None = None, address: str | None = None) -> None:
        """workers: tasks at once; all cores when None. address: of a running cluster; None starts one here.

        Ray is started or joined when the first unfinished task comes, so a build that finds everything finished never
        waits for it.
        """
        self.workers = workers or (os.cpu_count() or 1)
        self._asked_workers = workers
        self._address = address or os.environ.get("RAY_ADDRESS") or None
        self._remote: Any = None
        self._joined = False  # a Ray that was started here counts as well
        self._largest_node = 0.0

    def run(
        self, tasks: Iterable[Task], place: Workplace, followers_of: FollowersOf = no_followers
    ) -> Generator[TaskResult]:
        """See `Executor.run`."""
        workers = _RayWorkers(self, place)
        try:
            yield from run_backlog(Backlog(tasks, followers_of), place, workers)
        finally:
            self.stop(workers.running)

    def close(self) -> None:
        """Leaves the cluster, and stops it if it was started here."""
        self._remote = None
        if self._joined:
            import ray

            ray.shutdown()
            self._joined = False

    def window(self) -> int:
        """Tasks handed to Ray at once: a few more than can run, so that no worker waits for the driver."""
        if self._address is not None and self._asked_workers is not None:
            return self.workers
        return self.workers + max(2, self.workers // 4)

    def submit(self, attempt: _Attempt, place: Workplace) -> Any:
        """Hands a task to Ray; returns what it is waited for by. Raises MemoryLimitError where no machine holds it."""
        remote = self._connect()
        if attempt.memory > self._largest_node:
            raise MemoryLimitError(
                f"a task of stage {attempt.task.stage.name!r} needs about {attempt.memory / 2**30:.1f} GiB of memory, "
                f"the largest machine gives {self._largest_node / 2**30:.1f} GiB: use a larger one"
            )
        # The name is what Ray's dashboard and `ps` show of the worker.
        return remote.options(memory=attempt.memory, name=f"vlod {attempt.task.stage.name}").remote(attempt.task, place)

    def collect(self, reference: Any, attempt: _Attempt) -> TaskResult | None:
        """The result of a task that has ended; None if it is to be tried again. Raises the task's own error."""
        import ray
        from ray import exceptions

        stage = attempt.task.stage.name
        try:
            result: TaskResult = ray.get(reference)
        except exceptions.OutOfMemoryError:
            attempt.starved += 1
            attempt.memory = min(2 * attempt.memory, int(self._largest_node))
            if attempt.starved > MEMORY_ATTEMPTS:
                raise MemoryLimitError(
                    f"a task of stage {stage!r} ran out of memory {attempt.starved} times: use fewer --workers, "
                    "or machines with more memory"
                ) from None
            return None
        except (
            exceptions.TaskCancelledError,  # this executor cancels nothing that it still waits for: somebody else did
            exceptions.WorkerCrashedError,
            exceptions.NodeDiedError,
            exceptions.ObjectLostError,
            exceptions.LocalRayletDiedError,
            exceptions.TaskUnschedulableError,
        ) as error:
            attempt.lost += 1
            if attempt.lost >= ATTEMPTS:
                raise WorkerLostError(
                    f"the worker of a task of stage {stage!r} died {attempt.lost} times ({type(error).__name__}): "
                    "look for what kills it (memory, most often), then run the same command again"
                ) from None
            return None
        except exceptions.RayTaskError as error:
            raise error.cause from error
        return result

    def stop(self, running: dict[Any, _Attempt]) -> None:
        """Stops tasks at once. Their temporary results are cleaned later.

        Ray ends a driver's workers when it leaves; it is joined again when the next task comes. (Ray's own way of
        killing single tasks can abort the whole driver, where a task ends in the same moment.)
        """
        if not running:
            return
        if self._joined:
            self.close()
        else:
            import ray

            for reference in running:
                with contextlib.suppress(Exception):
                    ray.cancel(reference)
        running.clear()

    def _connect(self) -> Any:
        """The remote function; starts or joins Ray at first."""
        if self._remote is not None:
            return self._remote
        for name, value in _ENVIRONMENT.items():
            os.environ.setdefault(name, value)
        if self._address is None:
            os.environ.setdefault("RAY_AUTH_MODE", "disabled")
        import ray

        handler = signal.getsignal(signal.SIGTERM)
        if not ray.is_initialized():
            _knock(self._address)
            quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
            try:
                if self._address is None:
                    ray.init(
                        address="local",
                        num_cpus=self.workers,
                        include_dashboard=False,
                        object_store_memory=OBJECT_STORE,
                        **quiet,
                    )
                else:
                    ray.init(address=self._address, **quiet)
            except (ConnectionError, RuntimeError, ValueError) as error:
                where = self._address or "this machine"
                raise ClusterError(f"no Ray cluster at {where}: {str(error).splitlines()[0]}") from None
            self._joined = True
            # Ray answers SIGTERM with a dump of its stack.
            if threading.current_thread() is threading.main_thread():
                signal.signal(signal.SIGTERM, handler)
        if self._address is not None and self._asked_workers is None:
            self.workers = max(1, int(ray.cluster_resources().get("CPU", 1)))
        self._largest_node = max(
            (node["Resources"].get("memory", 0.0) for node in ray.nodes() if node["Alive"]), default=0.0
        )
        # Ray's own retries are off: they would be endless where memory runs out. `collect` decides.
        self._remote = ray.remote(num_cpus=1, max_retries=0)(_run_shown)
        return self._remote


class _RayWorkers:
    """The tasks of one run that Ray has."""

    def __init__(self, executor: RayExecutor, place: Workplace) -> None:
        self.running: dict[Any, _Attempt] = {}  # by what Ray knows them by
        self._executor, self._place = executor, place

    def has_room(self) -> bool:
        """See `jobs.running.executors.Workers`."""
        return len(self.running) < self._executor.window()

    def begin(self, task: Task) -> None:
        """See `jobs.running.executors.Workers`."""
        self._submit(_Attempt(task, task.memory))

    def is_busy(self) -> bool:
        """See `jobs.running.executors.Workers`."""
        return bool(self.running)

    def next_result(self) -> TaskResult | None:
        """See `jobs.running.executors.Workers`."""
        reference, attempt = _wait(self.running, self._place)
        result = self._executor.collect(reference, attempt)
        if result is None:
            self._submit(attempt)
        return result

    def _submit(self, attempt: _Attempt) -> None:
        self.running[self._executor.submit(attempt, self._place)] = attempt


def _run_shown(task: Task, place: Workplace) -> TaskResult:
    with shown(place):
        return run_task(task, place)


def _wait(running: dict[Any, _Attempt], place: Workplace) -> tuple[Any, _Attempt]:
    """The next task that has ended, taken out of the running. Tells of compiling meanwhile."""
    import ray

    told = False
    try:
        while True:
            ready, _ = ray.wait(list(running), num_returns=1, timeout=LOOK_SECONDS)
            if ready:
                return ready[0], running.pop(ready[0])
            if told:
                announce(False)
            told = seen(place)
            if told:
                announce(True)
    finally:
        if told:
            announce(False)


def _knock(address: str | None) -> None:
    """Raises ClusterError where nothing listens at a cluster's address: Ray would wait for minutes."""
    if address in (None, "auto", "local"):
        return
    host, _, port = address.rpartition("://")[2].rpartition(":")
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=CONNECT_SECONDS).close()
    except (OSError, ValueError, OverflowError) as error:
        raise ClusterError(f"no Ray cluster at {address} ({error}): give the head node's host:port") from None
