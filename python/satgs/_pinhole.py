"""The pinhole camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class PinholeCamera:
    """Pinhole camera without distortion. Its axes are those of COLMAP: x right, y down, z forward.

    Columns count right and rows down, in pixels; (0, 0) is the centre of the first pixel (COLMAP's principal point less half a
    pixel).

    Attributes:
        focal: Focal lengths of columns and rows, pixels.
        principal: Principal point (column, row), pixels.
        cam_from_world: Rotation from the axes of the world to those of the camera, row by row.
        center: The projection centre in the world.
        size: Columns and rows of the image.
    """

    focal: tuple[float, float]
    principal: tuple[float, float]
    cam_from_world: tuple[Triple, Triple, Triple]
    center: Triple
    size: tuple[int, int]

    @classmethod
    def looking_at(
        cls,
        center: ArrayLike,
        target: ArrayLike,
        *,
        size: tuple[int, int],
        focal_px: float,
        up: ArrayLike = (0.0, 0.0, 1.0),
    ) -> PinholeCamera:
        """A camera at ``center`` whose optical axis goes through ``target``, with ``up`` upwards in the image.

        Raises:
            ValueError: The target is the centre, or lies straight above or below it along ``up``.
        """
        eye = np.asarray(center, dtype=np.float64)
        forward = np.asarray(target, dtype=np.float64) - eye
        right = np.cross(forward, np.asarray(up, dtype=np.float64))
        if not np.linalg.norm(right) > 1e-9 * np.linalg.norm(forward):
            raise ValueError("the direction from `center` to `target` is that of `up`, or has no length")
        down = np.cross(forward, right)
        rows = [axis / np.linalg.norm(axis) for axis in (right, down, forward)]
        principal = ((size[0] - 1) / 2, (size[1] - 1) / 2)
        return cls((focal_px, focal_px), principal, _rows(rows), _triple(eye), size)

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Image positions (column, row) of points of shape (..., 3): shape (..., 2), NaN behind the camera."""
        seen = self._in_camera(points)
        depth = seen[..., 2:]
        in_front = np.where(depth > 0.0, depth, np.nan)
        return np.asarray(np.asarray(self.focal) * seen[..., :2] / in_front + np.asarray(self.principal))

    def depth(self, points: ArrayLike) -> NDArray[np.float64]:
        """Depths along the optical axis of points of shape (..., 3); negative behind the camera."""
        return np.asarray(self._in_camera(points)[..., 2])

    def unproject(self, pixels: ArrayLike, depth: ArrayLike) -> NDArray[np.float64]:
        """Points that pixels (column, row) of shape (..., 2) show at depths of shape (...): shape (..., 3)."""
        image = (np.asarray(pixels, dtype=np.float64) - np.asarray(self.principal)) / np.asarray(self.focal)
        along = np.concatenate([image, np.ones_like(image[..., :1])], axis=-1)
        seen = along * np.asarray(depth, dtype=np.float64)[..., None]
        return np.asarray(seen @ np.asarray(self.cam_from_world) + np.asarray(self.center))

    def resized(self, factor: float) -> PinholeCamera:
        """The camera of the image at ``factor`` times its size."""
        size = (round(self.size[0] * factor), round(self.size[1] * factor))
        focal = (self.focal[0] * factor, self.focal[1] * factor)
        principal = ((self.principal[0] + 0.5) * factor - 0.5, (self.principal[1] + 0.5) * factor - 0.5)
        return PinholeCamera(focal, principal, self.cam_from_world, self.center, size)

    def _in_camera(self, points: ArrayLike) -> NDArray[np.float64]:
        from_center = np.asarray(points, dtype=np.float64) - np.asarray(self.center)
        return np.asarray(from_center @ np.asarray(self.cam_from_world).T)


def _triple(values: NDArray[np.float64]) -> Triple:
    x, y, z = map(float, values)
    return x, y, z


def _rows(rows: list[NDArray[np.float64]]) -> tuple[Triple, Triple, Triple]:
    a, b, c = map(_triple, rows)
    return a, b, c
