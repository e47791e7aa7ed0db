"""What is hidden behind each pixel: a few pairs of depths, each the proof of one occluder set.

A pair (depth, limit) of a pixel says: every point whose image lies in the pixel, deeper than `depth` and no deeper than
`limit`, is hidden from the whole cell. A set in front hides what is right behind it, one further back hides farther, so
a pixel keeps the pairs that no other one makes superfluous: with increasing depth their limits increase. What is hidden
however deep it is stays so: a pair without a limit gives way only to one in front of it.
"""

from __future__ import annotations

import numpy as np

from storage.base.kernels import kernel

#: Depths are rounded up and limits down by this factor when they are stored: more than float32's rounding.
DEPTH_UP = 1.0 + 5e-7
LIMIT_DOWN = 1.0 - 5e-7


@kernel()
def add_layer(layers: np.ndarray, face: int, j: int, i: int, depth: float, limit: float) -> None:
    """Add a pair to a pixel. Where all its places are taken, the pair with the least limit for its depth is lost.

    layers: (6, r, r, k, 2) float32: pairs, increasing; (inf, 0) where there is none.
    """
    most = layers.shape[3]
    z, d = np.float32(depth * DEPTH_UP), np.float32(limit * LIMIT_DOWN)
    count = 0
    for k in range(most):
        zk, dk = layers[face, j, i, k, 0], layers[face, j, i, k, 1]
        if zk == np.inf:
            break
        if zk <= z and dk >= d:
            return
        count += 1
    kept = 0
    for k in range(count):
        zk, dk = layers[face, j, i, k, 0], layers[face, j, i, k, 1]
        if not (zk >= z and dk <= d):
            layers[face, j, i, kept, 0], layers[face, j, i, kept, 1] = zk, dk
            kept += 1
    if kept == most:
        least, worst = d / z, -1
        for k in range(most):
            ratio = layers[face, j, i, k, 1] / layers[face, j, i, k, 0]
            if ratio < least:
                least, worst = ratio, k
        if worst < 0:
            return
        for k in range(worst, most - 1):
            layers[face, j, i, k, 0], layers[face, j, i, k, 1] = (
                layers[face, j, i, k + 1, 0],
                layers[face, j, i, k + 1, 1],
            )
        kept -= 1
    k = kept
    while k > 0 and layers[face, j, i, k - 1, 0] > z:
        layers[face, j, i, k, 0], layers[face, j, i, k, 1] = (
            layers[face, j, i, k - 1, 0],
            layers[face, j, i, k - 1, 1],
        )
        k -= 1
    layers[face, j, i, k, 0], layers[face, j, i, k, 1] = z, d
    for rest in range(kept + 1, count):
        layers[face, j, i, rest, 0], layers[face, j, i, rest, 1] = np.float32(np.inf), np.float32(0.0)


@kernel(inline="always")
def pixel_hides(layers: np.ndarray, face: int, j: int, i: int, near: float, far: float) -> bool:
    """Whether all that lies in a pixel at depths from `near` to `far` is hidden."""
    hidden = False
    for k in range(layers.shape[3]):
        if not layers[face, j, i, k, 0] < near:
            break
        if layers[face, j, i, k, 1] >= far:
            hidden = True
            break
    return hidden


@kernel()
def clear_layers(layers: np.ndarray) -> None:
    """Nothing is hidden."""
    layers[:, :, :, :, 0] = np.inf
    layers[:, :, :, :, 1] = 0.0
