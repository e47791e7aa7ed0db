"""Where a build's tasks run, what they may take, and what is told of them.

None of it changes a result, but for cells that are too large for --memory.
"""

from __future__ import annotations

from pathlib import Path

import click

from jobs.options.sections import Section
from storage.base.amounts import Bytes

SECTION = Section(
    "Running",
    (
        click.Option(
            ["--executor"],
            type=click.Choice(["auto", "serial", "ray"]),
            default="auto",
            show_default=True,
            help="Where tasks run. auto: on Ray if a cluster's address is given (--ray-address or RAY_ADDRESS), or if "
            "Ray is installed and there are two cores or more; but one by one in this process as long as an input of "
            "less than 4 MB takes less than 10 seconds.",
        ),
        click.Option(
            ["--workers"],
            type=click.IntRange(min=1),
            metavar="N",
            help="Tasks at once on Ray. Default: all cores.",
        ),
        click.Option(
            ["--ray-address"],
            metavar="ADDRESS",
            help="Join this Ray cluster. Default: start Ray on this machine.",
        ),
        click.Option(
            ["--memory"],
            type=Bytes(),
            metavar="SIZE",
            default="2GiB",
            show_default=True,
            help="What one task may need, such as 4GiB or 1500MB. Cells that would need more are split unseen, and "
            "at the deepest level their pixel error is raised; anything else is refused before it begins.",
        ),
        click.Option(
            ["--work"],
            type=click.Path(path_type=Path, file_okay=False),
            help="Directory for finished tasks, on the store's disk; needless after the build. Default: STORE/work.",
        ),
        click.Option(
            ["--report"],
            type=click.Path(path_type=Path, dir_okay=False),
            help="Write the build report (JSON) here.",
        ),
        click.Option(["--json", "as_json"], is_flag=True, help="Print the build report as JSON."),
    ),
)
