"""How the model's parts become objects: the parameters, without anything that is slow to import."""

from __future__ import annotations

from dataclasses import dataclass, field

from storage.base.errors import ParameterError


@dataclass(frozen=True)
class Limits:
    """What an object may be before it is split."""

    triangles: int = 1000  # t1: objects with no more are never split
    size: float = 0.1  # s1: diagonal of the box, as a part of the model's
    ratio: float = 2.5  # r1: largest over smallest extent of the box
    most: int = 10_000  # objects with more triangles are split whatever their box

    def __post_init__(self) -> None:
        if not 16 <= self.triangles <= self.most:
            raise ParameterError(f"objects of {self.triangles} to {self.most} triangles: both must be at least 16")
        if not (self.size > 0 and self.ratio >= 1):
            raise ParameterError(
                f"the size of objects must be positive and their ratio at least 1, not {self.size} and {self.ratio}"
            )


@dataclass(frozen=True)
class Clustering:
    """What objects become one."""

    distance: float = 0.1  # D: edges join boxes that are nearer than this part of the model's largest extent
    cardinality: float = 1500.0  # K: clusters of more objects grow over ever shorter edges only; edges in units of D
    volume: float = 1e-3  # V: of a cluster's box, as a part of the volume of the model's
    neighbours: int = 24  # nearest objects that each one is joined to

    def __post_init__(self) -> None:
        if not (self.distance > 0 and self.cardinality >= 0 and self.volume >= 0 and self.neighbours >= 1):
            raise ParameterError(
                f"the distance of clusters must be positive, cardinality and volume not negative: {self.distance}, "
                f"{self.cardinality}, {self.volume}"
            )


@dataclass(frozen=True)
class ObjectOptions:
    """How pieces become objects."""

    clustering: Clustering = field(default_factory=Clustering)
    again: Limits = field(default_factory=lambda: Limits(triangles=10_000, size=0.2, ratio=1.25))  # Partition II
