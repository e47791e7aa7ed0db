"""What a check of a store found."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from typing import Any

#: Problems of one kind that are spelled out; the rest is counted.
MOST_SPELLED = 20


@dataclass
class Problems:
    """What is wrong, of one kind: the first MOST_SPELLED in words, the rest as a number."""

    spelled: list[str] = field(default_factory=list)
    more: int = 0

    def note(self, problems: Iterable[str]) -> None:
        """Note further problems, one line each."""
        for problem in problems:
            if len(self.spelled) < MOST_SPELLED:
                self.spelled.append(problem)
            else:
                self.more += 1

    def join(self, others: Problems) -> None:
        """Note what was found elsewhere."""
        self.note(others.spelled)
        self.more += others.more

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.spelled) + self.more


@dataclass(frozen=True)
class CellFindings:
    """What the oracle found in one cell."""

    cell: int
    key: int
    rays: int
    reported_drawables: int
    seen_drawables: int
    reported_triangles: int
    seen_triangles: int
    missed: int
    uniform_rays: int
    missed_rays: int
    refuted: int
    seconds: float


@dataclass
class VerifyReport:
    """The result of `verify`. `problems` is empty in a sound store."""

    store: str
    cells: int  # computed cells in the store
    samples: int  # rays asked for in each sampled cell
    seed: int
    approximation: str | None  # the option that lets the store miss something: that is measured and is no problem
    read_cells: int = 0  # cells whose vLODs were read again
    checksums: Problems = field(default_factory=Problems)
    sets: Problems = field(default_factory=Problems)
    detail: Problems = field(default_factory=Problems)
    visibility: Problems = field(default_factory=Problems)
    unreadable: int = 0  # computed cells in damaged shards: nothing but the damage is said of them
    sampled: list[CellFindings] = field(default_factory=list)
    stored_rays: int = 0  # hold-out rays of the sampled cells, as the store says
    stored_missed_rays: int = 0  # of these, missed
    seconds: float = 0.0

    @property
    def problems(self) -> list[str]:
        """What is wrong, one line each; not all of it where `untold` is above 0."""
        return [line for kind in self._kinds for line in kind.spelled]

    @property
    def untold(self) -> int:
        """Problems beyond those that are spelled out."""
        return sum(kind.more for kind in self._kinds)

    @property
    def _kinds(self) -> tuple[Problems, ...]:
        return self.checksums, self.sets, self.detail, self.visibility

    @property
    def ok(self) -> bool:
        """Whether nothing was found wrong."""
        return not self.problems

    @property
    def missed(self) -> int:
        """Drawables seen by the oracle but missing from a cell's vLOD."""
        return sum(cell.missed for cell in self.sampled)

    @property
    def uniform_rays(self) -> int:
        """Rays in uniform directions: each as good as a pixel of somebody in a cell."""
        return sum(cell.uniform_rays for cell in self.sampled)

    @property
    def missed_rays(self) -> int:
        """Uniform rays that met a missed drawable first: pixels that would be wrong."""
        return sum(cell.missed_rays for cell in self.sampled)

    @property
    def rays(self) -> int:
        """All rays cast."""
        return sum(cell.rays for cell in self.sampled)

    @property
    def tightness(self) -> dict[str, float | None]:
        """Reported over seen, all sampled cells together, in triangles and in drawables."""
        result: dict[str, float | None] = {}
        for unit in ("triangles", "drawables"):
            seen = sum(getattr(cell, f"seen_{unit}") for cell in self.sampled)
            reported = sum(getattr(cell, f"reported_{unit}") for cell in self.sampled)
            result[unit] = reported / seen if seen else None
        return result

    def to_json(self) -> dict[str, Any]:
        """Everything, ready for `json.dumps`."""
        return {
            "store": self.store,
            "ok": self.ok,
            "cells": self.cells,
            "unreadable_cells": self.unreadable,
            "read_cells": self.read_cells,
            "sampled_cells": len(self.sampled),
            "samples_per_cell": self.samples,
            "rays": self.rays,
            "missed": self.missed,
            "approximation": self.approximation,
            "uniform_rays": self.uniform_rays,
            "missed_rays": self.missed_rays,
            "stored_rays": self.stored_rays,
            "stored_missed_rays": self.stored_missed_rays,
            "refuted": sum(cell.refuted for cell in self.sampled),
            "tightness": self.tightness,
            "seconds": round(self.seconds, 3),
            "seed": self.seed,
            "problems": self.problems,
            "problems_untold": self.untold,
            "per_cell": [asdict(cell) for cell in self.sampled],
        }
