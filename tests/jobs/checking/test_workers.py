"""Work on one store in several processes: in order, and gone when it is over, however it ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from multiprocessing import active_children, resource_tracker
from pathlib import Path
from threading import Thread

import pytest

from jobs.checking.workers import Place, Workers
from jobs.running.errors import WorkerLostError
from storage.base.errors import ParameterError
from storage.store import Store
from tests.storage.tiny_store import make_store, room_parts


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    return make_store(tmp_path_factory.mktemp("workers") / "store", room_parts(), depth=2)


def place_of(store: Store) -> Place:
    return Place(store.files.url, store.manifest)


def who(place: Place, item: int) -> tuple[int, int, int]:
    """Ends the later the lower the item."""
    time.sleep(0.02 * (5 - item))
    return item, os.getpid(), len(place.store.cells)


def blocks_interrupts(_place: Place, _item: int) -> bool:
    time.sleep(0.1)
    return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def refuse(_place: Place, item: int) -> int:
    if item == 3:
        raise ParameterError("3 is refused")
    return item


def end(_place: Place, item: int) -> int:
    if item == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return item


def test_results_come_in_the_order_of_the_items(store: Store) -> None:
    with Workers(place_of(store), 3) as workers:
        found = list(workers.each(who, range(6)))
        again = list(workers.each(who, range(6)))
    assert [item for item, _, _ in found] == [item for item, _, _ in again] == list(range(6))
    processes = {process for _, process, _ in [*found, *again]}
    assert len(processes) == 3
    assert os.getpid() not in processes
    assert {cells for _, _, cells in found} == {64}
    assert not active_children()


def test_no_worker_hears_of_an_interrupt(store: Store) -> None:
    """The very first one neither: its start begins multiprocessing's tracker as well, where none runs yet."""
    resource_tracker._resource_tracker._stop()  # type: ignore[attr-defined]
    with Workers(place_of(store), 2) as workers:
        assert list(workers.each(blocks_interrupts, range(4))) == [True] * 4


def test_quick_work_stays_in_this_process(store: Store) -> None:
    with Workers(place_of(store)) as workers:
        assert {process for _, process, _ in workers.each(who, [4, 5])} == {os.getpid()}


def test_errors_are_raised_as_they_are(store: Store) -> None:
    with Workers(place_of(store), 2) as workers, pytest.raises(ParameterError, match="3 is refused"):
        list(workers.each(refuse, range(6)))
    assert not active_children()


def test_a_worker_that_dies_is_one_clear_error(store: Store) -> None:
    with Workers(place_of(store), 2) as workers, pytest.raises(WorkerLostError, match="use fewer --workers"):
        list(workers.each(end, range(6)))
    assert not active_children()


def test_a_worker_that_dies_while_it_begins_is_one_clear_error(store: Store) -> None:
    def kill() -> None:
        while not (children := active_children()):
            time.sleep(0.001)
        os.kill(int(children[0].pid or 0), signal.SIGKILL)

    killer = Thread(target=kill)
    killer.start()
    with Workers(place_of(store), 2) as workers, pytest.raises(WorkerLostError):
        list(workers.each(who, range(6)))
    killer.join()


def _children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def _alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def _until(holds: Callable[[], bool], seconds: float) -> bool:
    last = time.monotonic() + seconds
    while time.monotonic() < last:
        if holds():
            return True
        time.sleep(0.01)
    return holds()


@pytest.mark.parametrize("after", [0.0, 5.0])
@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGKILL])
def test_when_it_is_ended_everything_ends_at_once(store: Store, ending: signal.Signals, after: float) -> None:
    """While the workers begin, and while they cast rays: far more than could be cast in the time of this test."""
    code = "from storage.cli.command import main; main()"
    options = ["--workers", "2", "--cells", "64", "--samples", "1000000"]
    command = [sys.executable, "-c", code, "verify", store.files.url, *options]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert _until(lambda: len(_children(process.pid)) >= 2, 60)
    time.sleep(after)
    assert process.poll() is None
    children = _children(process.pid)
    if ending == signal.SIGINT:
        os.killpg(process.pid, signal.SIGINT)
        _, said = process.communicate(timeout=10)
        assert process.returncode == 130
        assert "Traceback" not in said
        assert said.endswith("interrupted\n")
    else:
        process.kill()
        process.communicate(timeout=60)
    assert _until(lambda: not any(map(_alive, children)), 30)
