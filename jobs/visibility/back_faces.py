"""Back-face culling of whole drawables for a view cell, by normal cones and visibility cones.

Based on: J. Chhugani et al.: vLOD, IEEE TVCG 11(1), 2005, section 5.1 (after S. Kumar, D. Manocha, W. Garrett, M. Lin:
Hierarchical back-face computation, 1999). The paper takes visibility cones at the eight corners of the drawable's box;
here one cone holds all directions from anywhere in the box to anywhere in the cell: the directions of the box of
differences, whose extremes are its eight corners.
"""

from __future__ import annotations

import numpy as np


def backs_only(
    lo: np.ndarray,
    hi: np.ndarray,
    cell_lo: np.ndarray,
    cell_hi: np.ndarray,
    cone_axis: np.ndarray,
    cone_angle: np.ndarray,
) -> np.ndarray:
    """Which drawables show nothing but the backs of their triangles to the whole cell.

    Args:
        lo, hi: (n, 3) float64 the drawables' boxes.
        cell_lo, cell_hi: (3,) float64, same units.
        cone_axis: (n, 3) unit axes of cones that hold all triangles' normals; cone_angle: (n,) half angles, radians.

    Returns:
        (n,) bool. *Why it is right:* let n be a triangle's normal, x a point of it, p in the cell. p - x lies in the
        visibility cone, n in the normal cone, so the angle between them is at least the angle between the two axes less
        both half angles. Above a right angle, p lies behind the triangle's plane.
    """
    near = cell_lo - hi
    far = cell_hi - lo
    axis = 0.5 * (near + far)
    length = np.sqrt((axis * axis).sum(axis=1))
    apart = ((near > 0) | (far < 0)).any(axis=1) & (length > 0)
    axis = axis / np.where(length > 0, length, 1.0)[:, None]
    least_cosine = np.ones(len(lo))
    for corner in np.ndindex(2, 2, 2):
        towards = np.where(np.array(corner) == 1, far, near)
        norm = np.sqrt((towards * towards).sum(axis=1))
        least_cosine = np.minimum(least_cosine, (towards * axis).sum(axis=1) / np.where(norm > 0, norm, 1.0))
    visibility_angle = np.arccos(np.clip(least_cosine, -1.0, 1.0))
    between = np.arccos(np.clip((axis * cone_axis).sum(axis=1), -1.0, 1.0))
    culled: np.ndarray = apart & (between - visibility_angle - cone_angle > 0.5 * np.pi + 1e-6)
    return culled
