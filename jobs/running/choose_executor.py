"""Which executor a build runs on."""

from __future__ import annotations

import importlib.util
import os

from jobs.running.executors import Executor, GrowingExecutor, SerialExecutor
from storage.base.errors import MissingDependencyError, ParameterError

#: Input size, in bytes, above which "auto" means Ray: about 10 to 20 seconds of work for one core.
AUTO_RAY_BYTES = 4_000_000


def choose_executor(name: str, workers: int | None, ray_address: str | None, input_bytes: int) -> Executor:
    """The executor that a user asked for: "serial", "ray", or "auto".

    "auto" is Ray if a cluster's address is given (or stands in RAY_ADDRESS), or if Ray is installed, there are two
    cores or more and the input is larger than AUTO_RAY_BYTES; with a smaller input, as soon as the work has taken a
    while: starting Ray takes seconds that little work never earns back.
    workers: tasks at once; None for all cores. Raises ParameterError for what does not fit together, and
    MissingDependencyError if Ray is asked for and not installed.
    """
    address = ray_address or os.environ.get("RAY_ADDRESS") or None
    installed = importlib.util.find_spec("ray") is not None
    cores = workers or os.cpu_count() or 1
    growing = name == "auto" and not address and input_bytes <= AUTO_RAY_BYTES
    if name == "auto":
        name = "ray" if address or (installed and cores > 1) else "serial"
    if name == "serial":
        if ray_address or (workers or 1) > 1:
            raise ParameterError(
                "--executor serial has one worker: leave --workers and --ray-address out, or choose ray"
            )
        return SerialExecutor()
    if not installed:
        raise MissingDependencyError("--executor ray needs Ray, which is not installed: pip install 'vlod[jobs]'")
    from jobs.running.ray_executor import RayExecutor

    ray = RayExecutor(workers, address)
    return GrowingExecutor(ray) if growing else ray
