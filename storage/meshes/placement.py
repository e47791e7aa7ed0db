"""How the matrix of a placement moves positions and normals: the same bits on every machine."""

from __future__ import annotations

import numpy as np

from storage.base.kernels import allocating_kernel

#: The matrix of what lies in model space already. Read-only.
IDENTITY = np.eye(3, 4)
IDENTITY.flags.writeable = False


def transform_points(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Model positions (n, 3) float64 of local `points` under a matrix (3, 4), or under one for each point (n, 3, 4).

    Other shapes broadcast: matrices (k, 1, 3, 4) place all points (n, 3) k times, (k, n, 3).
    Written out term by term: the same bits on every machine, whatever linear-algebra library numpy uses.
    """
    p = np.asarray(points, np.float64)
    m = np.asarray(matrix, np.float64)
    x, y, z = p[..., 0], p[..., 1], p[..., 2]
    rows = [((m[..., i, 0] * x + m[..., i, 1] * y) + m[..., i, 2] * z) + m[..., i, 3] for i in range(3)]
    return np.stack(rows, axis=-1)


@allocating_kernel()
def placed(points: np.ndarray, scale: float, matrix: np.ndarray, step: float) -> np.ndarray:
    """Grid coordinates (n, 3) int32, in units of `step`, of points (n, 3) int32 in units of `scale` under a matrix.

    matrix (3, 4) float64; scale and step are powers of two. The same bits as `transform_points` and `Grid.snap` give.
    """
    result = np.empty((len(points), 3), np.int32)
    for v in range(len(points)):
        x, y, z = points[v, 0] * scale, points[v, 1] * scale, points[v, 2] * scale
        for i in range(3):
            at = ((matrix[i, 0] * x + matrix[i, 1] * y) + matrix[i, 2] * z) + matrix[i, 3]
            result[v, i] = np.int32(np.rint(at * (1.0 / step)))
    return result


def normal_matrix(matrix: np.ndarray) -> tuple[np.ndarray, bool]:
    """What takes normals where a matrix (3, 4) takes positions, (3, 3) up to a positive factor; and whether it mirrors.

    That is the inverse transpose: the cofactors, with the determinant's sign. A mirroring matrix turns fronts into
    backs, unless the triangles' corners are taken the other way round. Written out term by term, as above.
    """
    (a, b, c), (d, e, f), (g, h, i) = np.asarray(matrix, np.float64)[:, :3].tolist()
    cofactors = np.array(
        [
            [e * i - f * h, f * g - d * i, d * h - e * g],
            [c * h - b * i, a * i - c * g, b * g - a * h],
            [b * f - c * e, c * d - a * f, a * e - b * d],
        ]
    )
    determinant = (a * cofactors[0, 0] + b * cofactors[0, 1]) + c * cofactors[0, 2]
    mirrored = bool(determinant < 0)
    return -cofactors if mirrored else cofactors, mirrored
