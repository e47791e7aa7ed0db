"""Damage of all kinds, by a seed: what tests of any reader throw at it, and how they see that it holds.

A damaged file is imported, or refused in one clear line that names it: no other error, no hang, no unbounded memory.
"""

from __future__ import annotations

import contextlib
import copy
import re
import resource
import shutil
import signal
import time
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from storage.base.errors import ModelError
from tests.jobs.importing.shapes import imported

#: What stands where something sensible stood.
ODD_VALUES: tuple[Any, ...] = (
    *(-1, 0, 1, 3, 255, 2**31, 2**53, 10**30, 1.5, -0.0, 1e308, float("nan"), float("inf")),
    *("", "x", "OPAQUE", None, True, [], {}, [0], [[]], {"a": 1}),
)


#: The same among words.
ODD_WORDS: tuple[bytes, ...] = tuple(
    b"0 1 -1 2 3 4 99 4294967295 -2147483648 9007199254740993 1e30 1e999 -1e-320 nan -inf 0x10 1/2/3 1//2 -1/-1 / // "
    b"x f v vt vn o g usemtl mtllib surf end facet vertex endsolid solid property element list float end_header OFF "
    b"<p> </p> <node> </node> <h> \xff\xfe \xe9 \xef\xbb\xbf # \\ -s -o -imfchan d Tr map_d map_Kd t.png".split()
)


class Hang(BaseException):
    """An import took too long; not an Exception, which readers turn into a clear line."""


def damaged(data: bytes, random: np.random.Generator) -> bytes:
    """Bytes with one to three things done to them: flipped, cut, cut out, doubled, swapped, blanked, or noise."""
    work = bytearray(data)
    for _ in range(int(random.integers(1, 4))):
        size = len(work)
        if size < 4:
            break
        a, b = sorted(int(place) for place in random.integers(0, size, 2))
        b = min(b, a + int(random.choice([1, 4, 40, 4000])))
        match int(random.integers(0, 8)):
            case 0 | 1:
                for place in random.integers(0, size, int(random.choice([1, 4, 20]))):
                    work[place] = int(random.integers(0, 256))
            case 2:
                work[int(random.integers(0, size))] ^= 1 << int(random.integers(0, 8))
            case 3:
                del work[max(a, 1) :]
            case 4:
                del work[a:b]
            case 5:
                work[a:a] = work[a:b]
            case 6:
                work[a:b] = bytes([int(random.choice([0, 255, 32]))]) * (b - a)
            case _:
                work[a:b] = work[b : b + (b - a)]
    return bytes(work)


def swapped(tree: Any, random: np.random.Generator) -> Any:
    """JSON with one to three of its values replaced, taken out, doubled, or put where another one was."""
    tree = copy.deepcopy(tree)
    for _ in range(int(random.integers(1, 4))):
        places = list(_places(tree))
        if not places:
            break
        holder, key = places[int(random.integers(len(places)))]
        match int(random.integers(0, 6)):
            case 0 | 1:
                holder[key] = copy.deepcopy(ODD_VALUES[int(random.integers(len(ODD_VALUES)))])
            case 2:
                other, place = places[int(random.integers(len(places)))]
                holder[key] = copy.deepcopy(other[place])
            case 3:
                del holder[key]
            case 4 if isinstance(holder, list):
                holder.insert(key, copy.deepcopy(holder[key]))
            case _:
                if isinstance(holder[key], int | float):
                    holder[key] = holder[key] + int(random.choice([-1, 1, 1000]))
    return tree


def _places(tree: Any) -> Iterator[tuple[Any, Any]]:
    """All holders of values, and the keys of the values in them."""
    stack = [tree]
    while stack:
        holder = stack.pop()
        keys = holder.keys() if isinstance(holder, dict) else range(len(holder)) if isinstance(holder, list) else ()
        for key in keys:
            yield holder, key
            stack.append(holder[key])


def words_swapped(text: bytes, random: np.random.Generator) -> bytes:
    """Text with one to six of its words replaced, taken out, doubled, swapped, or glued to the next."""
    words = re.split(rb"(\s+)", text)
    for _ in range(int(random.integers(1, 7))):
        place, other = (2 * int(half) for half in random.integers(0, (len(words) + 1) // 2, 2))
        match int(random.integers(0, 6)):
            case 0 | 1:
                words[place] = ODD_WORDS[int(random.integers(len(ODD_WORDS)))]
            case 2:
                words[place], words[other] = words[other], words[place]
            case 3:
                words[place] = b""
            case 4:
                words[place] += b" " + words[place]
            case _:
                words[min(place + 1, len(words) - 1)] = bytes(random.choice([b"", b"\n", b" ", b"\0", b"\r"]))
    return b"".join(words)


@contextlib.contextmanager
def no_longer_than(seconds: float) -> Iterator[None]:
    """Raise Hang in what takes longer."""

    def ring(_number: int, _frame: object) -> None:
        raise Hang(f"took longer than {seconds} s")

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def fuzz(
    folder: Path,
    name: str,
    make: Callable[[np.random.Generator], bytes],
    seconds: float,
    seed: int,
    hang: float = 60.0,
    memory: int = 1 << 30,
    beside: Collection[str] = (),
) -> dict[str, int]:
    """Import files called `name` that `make` makes, for some seconds; how many were read, and how many refused.

    Case k of a seed is the same on every machine. Fails with the case's number if an import raises anything but
    ModelError, in one line that names the file; leaves anything behind; takes longer than `hang` seconds; or if the
    process has grown by more than `memory` bytes. `beside`: other files that lie in `folder`.
    """
    path, counts, case = folder / name, {"read": 0, "refused": 0}, 0
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        path.write_bytes(make(np.random.default_rng([seed, case])))
        refusal = ""
        try:
            with no_longer_than(hang):
                imported(path, folder / "out")
            shutil.rmtree(folder / "out")
        except ModelError as error:
            refusal = str(error)
        except BaseException as error:
            raise AssertionError(f"case {case} of seed {seed}: {type(error).__name__}: {error}") from error
        counts["refused" if refusal else "read"] += 1
        assert not refusal or ("\n" not in refusal and str(path) in refusal), f"case {case}: {refusal}"
        assert {found.name for found in folder.iterdir()} == {name, *beside}, f"case {case}"
        grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
        assert grown < memory, f"case {case}: {grown} bytes"
        case += 1
    return counts
