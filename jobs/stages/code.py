"""The code that decides what stages give: changed code never meets old results, and other code throws none away.

What is imported and cannot change a byte of a result is not named: see APART. tests/test_walls.py holds that all else
that these modules import is named as well.
"""

from __future__ import annotations

_ALL = ("jobs.stages", "jobs.running.arrays", "storage")
DETAIL = (*_ALL, "jobs.detail", "jobs.importing", "jobs.objects")
IMPORTING = (*_ALL, "jobs.importing")
NODES = DETAIL
CELLS = (*_ALL, "jobs.cells", "jobs.visibility", "jobs.objects.weld")
LAYOUT = _ALL
SHARDS = _ALL
