"""Rooms are furnished: of all that they may hold, what the triangles last for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jobs.scenes.things.arrangements import Item, room_items
from jobs.scenes.things.draft import SceneDraft
from jobs.scenes.things.furnishings import BOOK_CAPACITY, BOOK_VARIANTS, books
from jobs.scenes.things.rooms import Room
from jobs.scenes.things.solids import turn_z


@dataclass(frozen=True)
class Plan:
    """What the rooms of a storey may hold."""

    rooms: tuple[Room, ...]
    items: tuple[Item, ...]
    priorities: NDArray[np.int64]  # of each item; the lowest number comes first
    costs: tuple[int, ...]  # triangles of each item

    @classmethod
    def of(cls, draft: SceneDraft, rooms: tuple[Room, ...]) -> Plan:
        """The plan for `rooms`; it serves any number of storeys."""
        items = tuple(item for room in rooms for item in room_items(room))
        priorities = np.array([item.priority for item in items])
        return cls(rooms, items, priorities, tuple(draft.cost(item.thing) for item in items))


def furnish(draft: SceneDraft, goal: int, plan: Plan, rng: np.random.Generator, name: str) -> None:
    """Furnish the rooms up to `goal` triangles (of the scene); books fill what is left."""
    rooms, items = plan.rooms, plan.items
    order = np.argsort(plan.priorities + rng.uniform(size=len(items))).tolist()
    left = goal - draft.writer.triangles
    chosen: list[int] = []
    shelves: dict[int, int] = {}  # item to the variant of books on it
    spare = 0 if left < 4000 else 12 * BOOK_CAPACITY
    for k in order:
        cost = plan.costs[k]
        if cost > left - spare:
            continue
        if items[k].thing == "shelf":
            variant = int(rng.integers(0, BOOK_VARIANTS))
            if cost + draft.cost(f"books {variant}") > left - spare:
                continue
            cost += draft.cost(f"books {variant}")
            shelves[k] = variant
        left -= cost
        chosen.append(k)
    fresh: dict[int, int] = {}  # item to the number of books of its own; they take up what is left
    for k in [k for k in order if items[k].thing == "shelf"]:
        extra = left // 12
        if extra < 1:
            break
        if k in shelves:
            owned = draft.cost(f"books {shelves[k]}") // 12
            if owned == BOOK_CAPACITY and extra < 8:
                continue
            fresh[k] = min(BOOK_CAPACITY, owned + extra)
            left -= 12 * (fresh[k] - owned)
            del shelves[k]
        elif draft.cost("shelf") + 12 <= left:
            left -= draft.cost("shelf")
            fresh[k] = min(BOOK_CAPACITY, left // 12)
            left -= 12 * fresh[k]
            chosen.append(k)
    by_room: dict[int, list[int]] = {room.number: [] for room in rooms}
    for k in sorted(chosen):
        by_room[items[k].room].append(k)
    for room in rooms:
        draft.writer.begin(f"{name} room {room.number} ({room.kind})")
        for k in by_room[room.number]:
            item = items[k]
            label = f"{name} room {room.number} {item.thing} {k}"
            turn = turn_z(item.degrees)
            draft.put(label, item.thing, item.at, turn)
            if k in shelves:
                draft.put(f"{label} books", f"books {shelves[k]}", item.at, turn)
            elif k in fresh:
                pairs = [(mesh, draft.material(material)) for mesh, material in books(fresh[k], rng)]
                draft.writer.place(f"{label} books", draft.writer.mesh(f"{label} books", pairs), item.at, turn)
        draft.writer.end()
