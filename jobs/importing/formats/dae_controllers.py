"""The controllers of COLLADA: skins and morphs, in the pose that their file is saved in.

A skinned vertex is where its joints take it: the sum over its joints of weight times joint times inverse bind matrix
times bind shape matrix. That is a place in the scene: the node that bears the controller does not move it. A morph adds
its targets with the weights that the file gives.

Based on: COLLADA, Digital Asset Schema Release 1.4.1, chapter 4, "Skin Deformation (or Skinning) in COLLADA", and the
elements skin, morph, joints, vertex_weights.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from jobs.importing.formats.dae_transforms import local_matrix, placed
from jobs.importing.reading.text.numbers import floats_of
from storage.meshes.placement import IDENTITY, transform_points

Element = ElementTree.Element


class Pose(NamedTuple):
    """What becomes of a geometry's positions."""

    key: str  # equal for equal poses of a geometry
    positions: np.ndarray | None  # (n, 3) in place of the geometry's
    matrices: np.ndarray | None  # (n, 3, 4) from there to the scene, one for each position

    @property
    def mirrors(self) -> bool:
        """Whether most of the geometry is turned inside out."""
        return self.matrices is not None and bool(np.sign(_cofactors(self.matrices)[1]).sum() < 0)

    def move(self, points: np.ndarray, normals: np.ndarray | None, at: np.ndarray) -> None:
        """Move vertices (k, 3) and their normals (k, 3), in place; `at` (k,) numbers their positions, -1 for none."""
        known = at >= 0
        index = at[known]
        if self.positions is not None:
            points[known] = self.positions[index]
        if self.matrices is None:
            return
        matrices = self.matrices[index]
        points[known] = transform_points(matrices, points[known])
        if normals is not None:
            cofactors, determinants = _cofactors(matrices)
            cofactors[determinants < 0] *= -1
            normals[known] = transform_points(cofactors, normals[known])


@dataclass(eq=False)
class Poses:
    """All controllers of a document."""

    root: Element
    named: Callable[..., Element | None]  # the element of one of some tags that a local URL names
    source: Callable[[str | None], np.ndarray | None]  # the values (count, width) of a source

    def __post_init__(self) -> None:
        self._parents: dict[Element, Element] | None = None
        self._worlds: dict[Element, np.ndarray | None] = {}

    def geometry(self, instance: Element) -> Element | None:
        """The geometry that an instance_controller shows, whatever its pose; None if there is none."""
        chain = self._chain(instance)
        return None if chain is None else chain[1]

    def bind_shape(self, instance: Element) -> np.ndarray:
        """The (3, 4) matrix of the shape that a skin is bound to."""
        chain = self._chain(instance)
        skin = next((c for c in chain[0] if c.tag == "skin"), None) if chain is not None else None
        values = floats_of(skin.findtext("bind_shape_matrix") or "") if skin is not None else np.empty(0)
        return values.reshape(4, 4)[:3] if len(values) == 16 and np.isfinite(values).all() else IDENTITY

    def pose(self, instance: Element) -> Pose | None:
        """The pose of what an instance_controller shows; None if it cannot be made out."""
        chain = self._chain(instance)
        if chain is None:
            return None
        controllers, geometry = chain
        positions = self._positions(geometry)
        if positions is None:
            return None
        matrices = None
        for number, controller in reversed(list(enumerate(controllers))):
            if controller.tag == "morph":
                positions = self._morphed(controller, positions)
                if positions is None:
                    return None
            elif number:
                return None  # a skin below another controller
            else:
                matrices = self._skin_matrices(controller, instance, len(positions))
                if matrices is None:
                    return None
        skeletons = sorted((skeleton.text or "").strip() for skeleton in instance.iter("skeleton"))
        morphed = any(controller.tag == "morph" for controller in controllers)
        key = " ".join([instance.get("url", ""), *skeletons])
        return Pose(key, positions if morphed else None, matrices)

    def _chain(self, instance: Element) -> tuple[list[Element], Element] | None:
        """The skins and morphs of an instance_controller, the outermost first, and the geometry below them."""
        found: list[Element] = []
        url = instance.get("url")
        while True:
            element = self.named(url, "controller", "geometry")
            if element is None or any(element.find(c.tag) is c for c in found):
                return None
            if element.tag == "geometry":
                return found, element
            controller = element.find("skin")
            controller = element.find("morph") if controller is None else controller
            if controller is None:
                return None
            found.append(controller)
            url = controller.get("source")

    def _positions(self, geometry: Element) -> np.ndarray | None:
        entry = geometry.find("mesh/vertices/input[@semantic='POSITION']")
        values = self.source(entry.get("source")) if entry is not None else None
        return values[:, :3] if values is not None and values.shape[1] >= 3 else None

    def _morphed(self, morph: Element, positions: np.ndarray) -> np.ndarray | None:
        inputs = {entry.get("semantic"): entry.get("source") for entry in morph.findall("targets/input")}
        targets, weights = self._words(inputs.get("MORPH_TARGET")), self.source(inputs.get("MORPH_WEIGHT"))
        if weights is None or len(weights) < len(targets) or not np.isfinite(weights).all():
            return None
        relative = morph.get("method", "NORMALIZED") == "RELATIVE"
        moved = positions.copy()
        for target, weight in zip(targets, weights[:, 0].tolist(), strict=False):
            geometry = self.named(target, "geometry")
            values = self._positions(geometry) if geometry is not None else None
            if values is None or len(values) != len(positions):
                return None
            moved += weight * (values if relative else values - positions)
        return moved

    def _skin_matrices(self, skin: Element, instance: Element, count: int) -> np.ndarray | None:
        """The matrix (n, 3, 4) of each of `count` positions."""
        inputs = {entry.get("semantic"): entry.get("source") for entry in skin.findall("joints/input")}
        names, inverse = self._words(inputs.get("JOINT")), self.source(inputs.get("INV_BIND_MATRIX"))
        shape = floats_of(skin.findtext("bind_shape_matrix") or "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1")
        if inverse is None or inverse.shape[1] != 16 or len(inverse) < len(names) or len(shape) != 16:
            return None
        bind = shape.reshape(4, 4)[:3]
        joints = [bind]  # of index -1: the bind shape itself
        for name, values in zip(names, inverse, strict=False):
            node = self._joint(name, instance)
            world = self._world(node) if node is not None else None
            if world is None:
                return None
            joints.append(placed(placed(world, values.reshape(4, 4)[:3]), bind))
        return self._weighted(skin, np.stack(joints), count)

    def _weighted(self, skin: Element, joints: np.ndarray, count: int) -> np.ndarray | None:
        """Means (n, 3, 4) of joints (k, 3, 4) by the skin's weights."""
        influences = skin.find("vertex_weights")
        entries = {} if influences is None else {e.get("semantic"): e for e in influences.findall("input")}
        if influences is None or not {"JOINT", "WEIGHT"} <= set(entries):
            return None
        joint_at, weight_at = (int(entries[name].get("offset", "0")) for name in ("JOINT", "WEIGHT"))
        weights = self.source(entries["WEIGHT"].get("source"))
        sizes, index = (_whole(influences.findtext(tag) or "") for tag in ("vcount", "v"))
        width = max(int(entry.get("offset", "0")) for entry in influences.findall("input")) + 1
        if weights is None or len(sizes) != count or (sizes < 0).any() or sizes.sum() * width != len(index):
            return None
        rows = index.reshape(-1, width)
        joint, weight = rows[:, joint_at] + 1, rows[:, weight_at]
        if len(rows) and not (joint.min() >= 0 and joint.max() < len(joints)):
            return None
        if len(rows) and not (weight.min() >= 0 and weight.max() < len(weights)):
            return None
        vertex = np.repeat(np.arange(count), sizes)
        share = weights[weight, 0]
        total = np.bincount(vertex, share, minlength=count)
        flat = joints.reshape(-1, 12)
        sums = np.stack([np.bincount(vertex, share * flat[joint, k], minlength=count) for k in range(12)], axis=1)
        unbound = ~(np.abs(total) > 0)
        means = sums / np.where(unbound, 1.0, total)[:, None]
        means[unbound] = flat[0]
        return means.reshape(-1, 3, 4) if np.isfinite(means).all() else None

    def _words(self, url: str | None) -> list[str]:
        """A source's names."""
        element = self.named(url, "source")
        if element is None:
            return []
        array = next((e for e in element if e.tag in ("Name_array", "IDREF_array", "SIDREF_array")), None)
        return (array.text or "").split() if array is not None else []

    def _joint(self, name: str, instance: Element) -> Element | None:
        """A joint by its sid below the skeletons of an instance, by its id, or by its sid anywhere."""
        roots = [self.named((skeleton.text or "").strip(), "node") for skeleton in instance.iter("skeleton")]
        for root in (*roots, None, self.root):
            if root is None:
                by_id = self.named(name, "node")
                if by_id is not None:
                    return by_id
                continue
            for node in root.iter("node"):
                if node.get("sid") == name:
                    return node
        return None

    def _world(self, node: Element) -> np.ndarray | None:
        """From a node to the scene, (3, 4); None if it is not in a scene, or a transform cannot be read."""
        if self._parents is None:
            self._parents = {child: parent for parent in self.root.iter() for child in parent}
        chain = []
        above: Element | None = node
        while above is not None and above.tag == "node" and above not in self._worlds:
            chain.append(above)
            above = self._parents.get(above)
        if above is not None and above.tag == "node":
            world = self._worlds[above]
        else:
            world = IDENTITY if above is not None and above.tag == "visual_scene" else None
        for each in reversed(chain):
            own = local_matrix(each)
            world = None if world is None or own is None else placed(world, own)
            self._worlds[each] = world
        return world


def _cofactors(matrices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of matrices (n, 3, 4) the cofactors (n, 3, 4), last column 0, and the determinants (n,)."""
    rows = matrices[:, :, :3]
    found = np.zeros_like(matrices)
    for i in range(3):
        for j in range(3):
            a, b, c, d = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            found[:, i, j] = rows[:, a, c] * rows[:, b, d] - rows[:, a, d] * rows[:, b, c]
    determinants = (rows[:, 0, 0] * found[:, 0, 0] + rows[:, 0, 1] * found[:, 0, 1]) + rows[:, 0, 2] * found[:, 0, 2]
    return found, determinants


def _whole(text: str) -> np.ndarray:
    """Whole numbers as int64; words that are none become -2."""
    values = floats_of(text)
    return np.where(np.isfinite(values) & (np.abs(values) < 2**53), values, -2).astype(np.int64)
