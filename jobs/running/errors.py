"""What can go wrong in a job beside bad input: a branch of the tree in `storage.base.errors`.

    VlodError
    └── JobError                a build could not go on
        ├── WorkInUseError      another build is in the work directory or the store (also a BlockingIOError)
        ├── WorkerLostError     a task's worker died again and again (also a RuntimeError)
        ├── MemoryLimitError    a task needs more memory than there is (also a MemoryError)
        ├── ClusterError        the cluster does not answer (also a ConnectionError)
        └── CodeMismatchError   a worker runs other code than the driver (also a RuntimeError)

Each says in one line what to do; the command line prints it and exits with 2.
"""

from __future__ import annotations

from storage.base.errors import VlodError


class JobError(VlodError):
    """A build could not go on."""


class WorkInUseError(JobError, BlockingIOError):
    """Another build, or what cleans up or mends, is using the work directory or the store."""


class WorkerLostError(JobError, RuntimeError):
    """A task's worker process died again and again."""


class MemoryLimitError(JobError, MemoryError):
    """A task needs more memory than any machine of the job has."""


class ClusterError(JobError, ConnectionError):
    """The cluster does not answer."""


class CodeMismatchError(JobError, RuntimeError):
    """A worker runs other code than the driver."""
