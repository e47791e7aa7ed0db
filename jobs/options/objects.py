"""What is drawn or left out as a whole: how parts become pieces, and pieces objects."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import click

from jobs.detail.detail_options import DetailOptions
from jobs.objects.object_options import Clustering, Limits, ObjectOptions
from jobs.options.sections import Group, Section

#: Objects have at most this many times the triangles that a part has before it may be split: t2 / t1.
AGAIN = 10

#: Named settings of what objects are. "gigawalk": the paper's (W. V. Baxter et al., GigaWalk, UNC TR02-013, 2002,
#: sections 4.2 and 6.3.1). "balanced": smaller clusters and a tighter limit of size. Along the demo's path it draws
#: 77,770 triangles a frame where the paper's draw 123,299, culling by the view alone 161,466 where they draw 200,192;
#: with parts of 300 triangles these would be 65,638, but what is far away takes two to four times as many.
OBJECTS: dict[str, dict[str, float]] = {
    "balanced": {"object_triangles": 1000, "object_size": 0.05, "object_ratio": 2.5, "cluster_volume": 1e-5},
    "gigawalk": {"object_triangles": 1000, "object_size": 0.1, "object_ratio": 2.5, "cluster_volume": 1e-3},
}


@dataclass(frozen=True)
class ObjectParameters(Group):
    """How parts become pieces, and pieces objects."""

    object_triangles: int = 1000  # t1 of Partition I: parts with more are split if they are large or long
    object_size: float = 0.05  # s1: large is a diagonal above this part of the model's
    object_ratio: float = 2.5  # r1: long is a box whose longest edge is this many times its shortest
    cluster_distance: float = 0.1  # D: parts nearer than this part of the model's extent may become one object
    cluster_cardinality: float = 1500.0  # K: about how many parts one object is made of at most
    cluster_volume: float = 1e-5  # V: largest box of an object of several parts, as a part of the model's

    def check(self) -> None:
        """Raises ParameterError for what is out of range."""
        self.detail()
        self.objects()

    def detail(self) -> DetailOptions:
        """How pieces and levels are made: Partition I. Raises ParameterError."""
        return DetailOptions(
            Limits(self.object_triangles, self.object_size, self.object_ratio, AGAIN * self.object_triangles)
        )

    def objects(self) -> ObjectOptions:
        """How pieces become objects: clustering and Partition II. Raises ParameterError."""
        return ObjectOptions(
            Clustering(self.cluster_distance, self.cluster_cardinality, self.cluster_volume),
            Limits(
                AGAIN * self.object_triangles,
                2 * self.object_size,
                max(1.0, self.object_ratio / 2),
                AGAIN * self.object_triangles,
            ),
        )


def filled_in(options: dict[str, Any]) -> dict[str, Any]:
    """Options as they were given, and those of objects that were not: the named setting's numbers."""
    named = OBJECTS[options["objects"]]
    given = {name: value for name, value in options.items() if name != "objects"}
    return {**given, **{name: value for name, value in named.items() if given[name] is None}}


SECTION = Section(
    "Objects",
    (
        click.Option(
            ["--objects"],
            type=click.Choice(list(OBJECTS)),
            default="balanced",
            show_default=True,
            help="What is drawn or left out as a whole. gigawalk: larger objects, as in the paper of that name: fewer "
            "drawables, more triangles. The options below change single numbers of it.",
        ),
        click.Option(
            ["--object-triangles"],
            type=int,
            help="Parts with more triangles are split where they are large or long; objects have at most ten times as "
            "many.",
        ),
        click.Option(
            ["--object-size"],
            type=float,
            help="What counts as large: a diagonal above this part of the model's.",
        ),
        click.Option(
            ["--object-ratio"],
            type=float,
            help="What counts as long: a box whose longest edge is this many times its shortest.",
        ),
        click.Option(
            ["--cluster-distance"],
            type=float,
            default=ObjectParameters.cluster_distance,
            show_default=True,
            help="Parts nearer than this part of the model's extent may become one object.",
        ),
        click.Option(
            ["--cluster-cardinality"],
            type=float,
            default=1500,
            show_default=True,
            help="About how many parts one object is made of at most.",
        ),
        click.Option(
            ["--cluster-volume"],
            type=float,
            help="Largest box of an object of several parts, as a part of the model's.  0: none are joined.",
        ),
    ),
)
