"""The memory of a check follows neither the number of cells nor what is seen from them."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.jobs.checking.tower_store import Tower, make_tower

#: Checks a store in a process of its own: the findings, and the most memory of it and of each of its workers, in bytes.
VERIFY = """
import json, sys
from jobs.checking.verify import verify
from tests.jobs.checking.peaks import Watch

with Watch() as watch:
    found = verify(sys.argv[1], samples=300, cells=3, workers=int(sys.argv[2])).to_json()
del found["seconds"]
for cell in found["per_cell"]:
    del cell["seconds"]
print(json.dumps([found, [use.peak for use in watch.processes.values()]]))
"""

#: Bytes that one process may take. The vLODs of all cells would be 177 MB beside the 160 MB of a process that has read
#: a single cell, and the triangles that rays from one cell may meet as much again.
MOST = 360 << 20


@pytest.mark.slow
def test_thousands_of_cells_that_see_thousands_of_drawables_are_checked_in_little_memory(tmp_path: Path) -> None:
    store = make_tower(tmp_path / "store", Tower(depth=4, floors=8, sight=8, copies=5))
    assert len(store.cells) == 4096
    assert 8 * store.cells["drawables"].sum() > 170e6
    found = []
    for workers in (1, 2):
        command = [sys.executable, "-c", VERIFY, str(tmp_path / "store"), str(workers)]
        done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=600)
        report, peaks = json.loads(done.stdout)
        assert len(peaks) == (1 if workers == 1 else 3)
        assert max(peaks) < MOST, peaks
        assert (report["read_cells"], report["rays"], report["problems"]) == (4096, 900, [])
        found.append(report)
    assert found[0] == found[1]
