"""Names of files and folders that are being written, and which of them their writers have left behind.

A name says who writes: `.tmp-<host>-<process>-<number>`. What a killed writer left behind can so be told from what a
living one is still writing.
"""

from __future__ import annotations

import os
import secrets
import socket
import time
from pathlib import Path

#: What all temporary names begin with.
PREFIX = ".tmp-"

#: Leftovers of other machines' processes, which cannot be asked, count as abandoned when they are older, in seconds.
FOREIGN_LEFTOVER_AGE = 24 * 3600.0


def temporary_path(folder: Path) -> Path:
    """A path in `folder` that nothing else uses. Nothing is made there yet."""
    return folder / f"{PREFIX}{host()}-{os.getpid()}-{secrets.token_hex(8)}"


def abandoned(folder: Path) -> list[Path]:
    """Temporary files and folders in `folder` whose writers live no more, sorted; none where there is no folder."""
    return [path for path in sorted(folder.glob(f"{PREFIX}*")) if _is_abandoned(path)]


def _is_abandoned(path: Path) -> bool:
    writer, _, process = path.name.removeprefix(PREFIX).rpartition("-")[0].rpartition("-")
    if writer != host():
        try:
            return time.time() - path.stat().st_mtime > FOREIGN_LEFTOVER_AGE
        except OSError:
            return False
    try:
        os.kill(int(process), 0)
    except (ProcessLookupError, ValueError, OverflowError):
        return True
    except PermissionError:
        return False
    return False


def host() -> str:
    """The name that this machine's writers go by."""
    return socket.gethostname() or "localhost"
