"""Rotations in space: unit quaternions (w, x, y, z), matrices, and the angles yaw, pitch and roll.

A rotation R takes the components of a vector in the rotated frame to those in the fixed frame. Yaw, pitch and roll are the angles
of R = Rz(yaw) Ry(pitch) Rx(roll); they are unique for a pitch between -90 and 90 degrees.
"""

import numpy as np

from whisker_sim.whisker import Array

Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]

_UNIT = 1e-6
"""Tolerance of the norm of a quaternion in a scene, which covers six written decimals."""


def checked_quaternion(key: str, quaternion: Quaternion) -> None:
    """Raises `ValueError` unless `quaternion` has the norm 1 to within 1e-6."""
    norm = float(np.linalg.norm(quaternion))
    if not abs(norm - 1.0) <= _UNIT:
        raise ValueError(f"{key}: expected a unit quaternion (w, x, y, z), found the norm {norm:.9g}")


def checked_direction(key: str, vector: Vector) -> None:
    """Raises `ValueError` if `vector` has no direction."""
    if not np.linalg.norm(vector) > 0.0:
        raise ValueError(f"{key}: expected a vector that is not zero, found {list(vector)}")


def unit(vector: Array | Vector) -> Array:
    """Vectors (..., 3) scaled to the length 1."""
    vector = np.asarray(vector, dtype=float)
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


def matrix_of(quaternion: Array | Quaternion) -> Array:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4), which are normalised."""
    quaternion = np.asarray(quaternion, dtype=float)
    w, x, y, z = np.moveaxis(quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True), -1, 0)
    rows = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternion_of(matrix: Array) -> Array:
    """Unit quaternions (..., 4) of rotation matrices (..., 3, 3), with w >= 0.

    Of the four quaternions that follow from the components, each multiplied by one of them, the longest is taken (Shepperd, 1978).
    """
    trace = np.trace(matrix, axis1=-2, axis2=-1)
    a, b, c = matrix[..., 2, 1], matrix[..., 0, 2], matrix[..., 1, 0]
    d, e, f = matrix[..., 1, 2], matrix[..., 2, 0], matrix[..., 0, 1]
    x, y, z = (matrix[..., i, i] for i in range(3))
    candidates = np.stack(
        [
            np.stack((1.0 + trace, a - d, b - e, c - f), axis=-1),
            np.stack((a - d, 1.0 + x - y - z, c + f, b + e), axis=-1),
            np.stack((b - e, c + f, 1.0 - x + y - z, a + d), axis=-1),
            np.stack((c - f, b + e, a + d, 1.0 - x - y + z), axis=-1),
        ],
        axis=-2,
    )
    norms = np.linalg.norm(candidates, axis=-1)
    longest = np.argmax(norms, axis=-1)[..., None, None]
    quaternion = unit(np.take_along_axis(candidates, longest, axis=-2)[..., 0, :])
    return np.where(quaternion[..., :1] < 0.0, -quaternion, quaternion)


def about(axis: int, angle_rad: Array | float) -> Array:
    """Rotations (..., 3, 3) about a coordinate axis by the angles (...)."""
    angle_rad = np.asarray(angle_rad, dtype=float)
    rotation = np.zeros((*angle_rad.shape, 3, 3))
    j, k = (axis + 1) % 3, (axis + 2) % 3
    rotation[..., axis, axis] = 1.0
    rotation[..., j, j] = rotation[..., k, k] = np.cos(angle_rad)
    rotation[..., k, j] = np.sin(angle_rad)
    rotation[..., j, k] = -np.sin(angle_rad)
    return rotation


def turn(vector_rad: Array) -> Array:
    """Rotations (..., 3, 3) by the rotation vectors (..., 3)."""
    half_rad = 0.5 * np.linalg.norm(vector_rad, axis=-1, keepdims=True)
    return matrix_of(np.concatenate((np.cos(half_rad), 0.5 * np.sinc(half_rad / np.pi) * vector_rad), axis=-1))


def yaw_pitch_roll(matrix: Array) -> Array:
    """Yaw, pitch and roll (..., 3) of rotation matrices (..., 3, 3)."""
    pitch = np.arctan2(-matrix[..., 2, 0], np.hypot(matrix[..., 0, 0], matrix[..., 1, 0]))
    yaw = np.arctan2(matrix[..., 1, 0], matrix[..., 0, 0])
    roll = np.arctan2(matrix[..., 2, 1], matrix[..., 2, 2])
    return np.stack((yaw, pitch, roll), axis=-1)


def from_yaw_pitch_roll(angles_rad: Array) -> Array:
    """Rotation matrices (..., 3, 3) of yaw, pitch and roll (..., 3)."""
    return about(2, angles_rad[..., 0]) @ about(1, angles_rad[..., 1]) @ about(0, angles_rad[..., 2])


def applied(matrix: Array, vectors: Array) -> Array:
    """Vectors (..., 3) rotated by matrices (..., 3, 3), which are broadcast."""
    return np.einsum("...ij,...j->...i", matrix, vectors)


def undone(matrix: Array, vectors: Array) -> Array:
    """Vectors (..., 3) rotated by the inverses of matrices (..., 3, 3), which are broadcast."""
    return np.einsum("...ji,...j->...i", matrix, vectors)


def continuous(quaternions: Array) -> Array:
    """The same rotations (n, 4) with signs that make each quaternion the nearer one to its predecessor; w >= 0 in the first."""
    products = np.sum(quaternions[1:] * quaternions[:-1], axis=1)
    signs = np.cumprod(np.concatenate(([1.0 if quaternions[0, 0] >= 0.0 else -1.0], np.where(products < 0.0, -1.0, 1.0))))
    return quaternions * signs[:, None]
