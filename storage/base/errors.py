"""Everything that can go wrong for a user, as one small tree.

    VlodError                      base of all errors that a user can cause or cure
    ├── StoreError                 something about a store
    │   ├── StoreNotFoundError     no store at that place (also a FileNotFoundError)
    │   ├── StoreFormatError       a store of a format that this version of vLOD does not read (also a ValueError)
    │   ├── CorruptStoreError      bytes are missing or changed; `file` is what is damaged (also a ValueError)
    │   ├── StoreUnreachableError  the store's place cannot be read: permissions, network (also an OSError)
    │   └── NotComputedError       a cell for which nothing was computed (also a LookupError)
    ├── ModelError                 an input that is not a model, or that cannot be used (also a ValueError)
    ├── ParameterError             a parameter or option outside its range (also a ValueError)
    └── MissingDependencyError     an optional dependency is not installed (also an ImportError)

Each class is also the built-in exception that it is, so callers may catch either. The message is one line that names
the path or value, says what was expected, and what to do. The command line prints that line and exits with 2.
"""

from __future__ import annotations

#: What helps against damage.
CURE = "copy it again, or mend it: `vlod verify STORE --repair`"


class VlodError(Exception):
    """Base of all errors that a user can cause or cure. The message is one line."""


class StoreError(VlodError):
    """Something about a store."""


class StoreNotFoundError(StoreError, FileNotFoundError):
    """There is no store at the given place."""


class StoreFormatError(StoreError, ValueError):
    """The store's format is not one that this version of vLOD reads."""


class CorruptStoreError(StoreError, ValueError):
    """Bytes of a store are missing or changed. The message names the file.

    file: the file's path inside the store; None where that is not known yet.
    """

    def __init__(self, message: str, file: str | None = None) -> None:
        super().__init__(message)
        self.file = file


class StoreUnreachableError(StoreError, OSError):
    """The store's place cannot be read: permissions, network, server."""


class NotComputedError(StoreError, LookupError):
    """A cell for which nothing was computed."""


class ModelError(VlodError, ValueError):
    """An input that is not a model, or a model that cannot be used."""


class ParameterError(VlodError, ValueError):
    """A parameter or option outside its range."""


class MissingDependencyError(VlodError, ImportError):
    """An optional dependency is not installed."""
