"""What a user can choose by name: one line for each thing, from which options, keys and help are made.

The thing itself lies in a file of its own and is imported only when it is chosen, so that help comes at once.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Generic, NamedTuple, TypeVar

from storage.base.errors import ParameterError

Thing = TypeVar("Thing")


class Offer(NamedTuple, Generic[Thing]):
    """One thing to choose."""

    name: str  # as it is typed
    shows: str  # what one gets, in a few words
    place: str  # where it lies: "module:attribute"

    def load(self) -> Thing:
        """The thing, imported now."""
        module, _, attribute = self.place.partition(":")
        thing: Thing = getattr(importlib.import_module(module), attribute)
        return thing


def names(offers: Sequence[Offer]) -> list[str]:
    """The names, in order."""
    return [offer.name for offer in offers]


def named(offers: Sequence[Offer[Thing]], name: str, kind: str) -> Offer[Thing]:
    """The offer of that name. Raises ParameterError, which lists the names; kind: what is offered, such as "tour"."""
    for offer in offers:
        if offer.name == name:
            return offer
    raise ParameterError(f"there is no {kind} {name!r}: give one of {', '.join(names(offers))}")


def explained(offers: Sequence[Offer]) -> str:
    """All of them in one sentence, for help."""
    return "; ".join(f"{offer.name}: {offer.shows}" for offer in offers) + "."
