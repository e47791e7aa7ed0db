"""Writing a demo scene of a given kind, size and seed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jobs.scenes.kinds import KINDS, scene_kind
from jobs.scenes.things.draft import Progress, SceneDraft, SceneKind
from jobs.scenes.things.glb import GlbWriter, y_up
from storage.base.errors import ParameterError

MINIMUM_TRIANGLES = 20_000
MAXIMUM_TRIANGLES = 200_000_000
MAXIMUM_SEED = 2**32 - 1


@dataclass(frozen=True)
class SceneRecord:
    """What was written."""

    kind: str
    seed: int
    triangles: int  # every instance counted
    unique_triangles: int  # in distinct meshes
    nodes: int
    meshes: int
    bytes: int  # of the file
    tour: NDArray[np.float64]  # (n, 3) way points of a walk at eye height, metres, y up; its legs meet no wall


def _checked(kind: str, triangles: int, seed: int) -> SceneKind:
    """The kind's makers. Raises ParameterError for what cannot be made."""
    if kind not in KINDS:
        raise ParameterError(f"there is no demo scene {kind!r}: choose one of {', '.join(KINDS)}")
    if not MINIMUM_TRIANGLES <= triangles <= MAXIMUM_TRIANGLES:
        raise ParameterError(
            f"a demo scene of {triangles:,} triangles cannot be made: "
            f"ask for {MINIMUM_TRIANGLES:,} to {MAXIMUM_TRIANGLES:,}"
        )
    if not 0 <= seed <= MAXIMUM_SEED:
        raise ParameterError(f"the seed {seed} is out of range: choose 0 to {MAXIMUM_SEED}")
    return scene_kind(kind)


def write_scene(kind: str, out: Path, triangles: int, seed: int, progress: Progress | None = None) -> SceneRecord:
    """Write the demo scene `kind` (one of KINDS) as binary glTF 2.0 to `out` (a .glb): metres, y up.

    The same kind, triangles and seed give the same bytes. `triangles` is met within 3 %, instances counted each time.
    The file appears under its name only when it is complete; an existing one is replaced. Memory does not grow with
    the scene. The scene's `extras` hold kind, seed, triangles and the tour. `progress` gets (triangles done, in all).
    Raises ParameterError for an unknown kind, a size or seed out of range, a name that does not end in .glb, a missing
    folder, and for a scene that does not fit into a GLB file (4 GiB); OSError if the disk refuses.
    """
    maker = _checked(kind, triangles, seed)
    if out.suffix.lower() != ".glb":
        raise ParameterError(f"{out}: demo scenes are written as binary glTF: choose a name that ends in .glb")
    if not out.parent.is_dir():
        raise ParameterError(f"{out}: there is no folder {out.parent}: create it first")
    if out.is_dir():
        raise ParameterError(f"{out}: this is a folder: choose the name of a file")
    tour = y_up(maker.walk(triangles, seed).tour)
    with GlbWriter(out) as writer:
        maker.build(SceneDraft(writer, triangles, maker.recipes, progress), triangles, seed)
        extras = {"kind": kind, "seed": seed, "triangles": writer.triangles, "tour": np.round(tour, 4).tolist()}
        size = writer.finish(extras)
        if progress is not None:
            progress(triangles, triangles)
        return SceneRecord(
            kind, seed, writer.triangles, writer.unique_triangles, writer.nodes, writer.meshes, size, tour
        )


def viewpoints(kind: str, triangles: int, seed: int) -> NDArray[np.float64]:
    """Places (n, 3) where a person's eyes can be in the scene that the same arguments write: metres, y up.

    Raises ParameterError as `write_scene` does.
    """
    return y_up(_checked(kind, triangles, seed).walk(triangles, seed).viewpoints)
