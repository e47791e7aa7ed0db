"""What the player knows of a store: its tables, with the boxes of nodes laid out for fast tests.

What is asked of few drawables at a time is read from the store's own tables: these are never copied as a whole.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from player.camera.view import Boxes, boxes_between
from storage.model.tree import leaves, parents
from storage.store import Store


@dataclass(frozen=True, eq=False)
class ShownModel:
    """A store's model as the player sees it."""

    store: Store
    node_boxes: Boxes
    first_drawable: NDArray[np.int64]  # (nodes,)
    levels: NDArray[np.int64]  # (nodes,)
    parent: NDArray[np.int64]  # (nodes,) the node above each one, -1 above roots
    leaves: NDArray[np.int64]  # the nodes with none below them
    see_through: bool  # something can be seen through
    lo: NDArray[np.float64]  # (3,) box of the whole model
    hi: NDArray[np.float64]

    def nodes_of(self, drawables: NDArray[np.int64]) -> NDArray[np.int64]:
        """The nodes (n,) of drawables (n,)."""
        return self.store.drawables["node"][drawables].astype(np.int64)

    @property
    def extent(self) -> float:
        """Diagonal of the model's box, in model units; 1 for a model that is a point."""
        size = self.hi - self.lo
        return float(np.sqrt((size * size).sum())) or 1.0

    @property
    def pixel_error(self) -> float:
        """The error in pixels that the store was built for."""
        return float(self.store.manifest.parameters.get("pixel_error", 1.0))


def shown_model(store: Store) -> ShownModel:
    """The model of an opened store."""
    nodes = store.nodes
    return ShownModel(
        store=store,
        node_boxes=boxes_between(nodes["lo"], nodes["hi"]),
        first_drawable=nodes["first_drawable"].astype(np.int64),
        levels=nodes["levels"].astype(np.int64),
        parent=parents(nodes),
        leaves=np.flatnonzero(leaves(nodes)),
        see_through=bool(store.drawables["see_through"].any()),
        lo=np.asarray(store.manifest.model.lo, np.float64),
        hi=np.asarray(store.manifest.model.hi, np.float64),
    )
