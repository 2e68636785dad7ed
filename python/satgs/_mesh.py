"""Triangle meshes as arrays, and depth maps that become one; `satgs._satgs` reads, writes and fuses them."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from satgs import _satgs, events
from satgs._command_words import listener
from satgs._pinhole import PinholeCamera
from satgs._site import Site


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh. Its third axis points up.

    Attributes:
        vertices: Positions, shape (n, 3).
        triangles: Three vertices each, counter-clockwise seen from outside, shape (m, 3).
        normals: Unit normals of the vertices, outwards, shape (n, 3); ``None`` without normals.
        colors: Red, green and blue of the vertices, 0 to 255, shape (n, 3); ``None`` without colours.
        site: Where the frame of the mesh stands on Earth; ``None`` of a frame without a place.
    """

    vertices: NDArray[np.float64] = field(repr=False)
    triangles: NDArray[np.uint32] = field(repr=False)
    normals: NDArray[np.float32] | None = field(default=None, repr=False)
    colors: NDArray[np.uint8] | None = field(default=None, repr=False)
    site: Site | None = None

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Mesh:
        """Reads a PLY or OBJ file, and its georeference if one is beside it. Polygons become triangles.

        Raises:
            InputError: The file cannot be read, is damaged or holds no triangles.
        """
        made = _satgs.read_mesh(path)
        site = made.pop("site")
        return cls(**made, site=None if site is None else Site(*site))

    def write(self, path: str | os.PathLike[str]) -> None:
        """Writes the mesh in the format of the file's name (``.ply``, ``.obj``, ``.glb``), and its georeference beside it.

        Raises:
            ValueError: An array has another shape, a value is not finite, or a triangle names a vertex that does not exist.
            InputError: The ending is another one.
            FailedError: The file cannot be written.
        """
        arrays: dict[str, NDArray[Any] | None] = {
            "vertices": np.asarray(self.vertices, dtype=np.float64),
            "triangles": np.asarray(self.triangles, dtype=np.uint32),
            "normals": None if self.normals is None else np.asarray(self.normals, dtype=np.float32),
            "colors": None if self.colors is None else np.asarray(self.colors, dtype=np.uint8),
        }
        site = None if self.site is None else (self.site.epsg, self.site.origin)
        _satgs.write_mesh(path, arrays, site)


def fuse_depths(
    cameras: Iterable[PinholeCamera],
    depths: Iterable[ArrayLike],
    *,
    voxel: float,
    colors: Iterable[ArrayLike] | None = None,
    truncation: float | None = None,
    depth_max: float | None = None,
    most_pieces: int = 50,
    least_triangles: int = 50,
    progress: events.Progress | bool | None = None,
) -> Mesh:
    """Fuses depth maps to a mesh (TSDF, marching cubes). Lengths are in the unit of the cameras' positions.

    Args:
        cameras: The cameras.
        depths: The depth map of each camera: distances along its optical axis, shape (rows, columns). Zero, negative and NaN
            are not known.
        voxel: Side of a voxel.
        colors: The picture of each camera, 0 to 1, shape (rows, columns, 3). ``None``: a mesh without colours.
        truncation: Truncation distance of the TSDF, in the unit of the scene. ``None``: five voxels.
        depth_max: Depths beyond this are not used. ``None``: all are.
        most_pieces: Number of pieces that are kept, the largest.
        least_triangles: Number of triangles of the smallest piece that is kept.
        progress: Receives the events of the work (:mod:`satgs.events`); ``True`` shows bars of tqdm.

    Raises:
        ValueError: There are not as many depth maps and pictures as cameras, or an array has another shape.
        InputError: A depth map has not the size of its camera, the volume would be too large, or there is no surface.
    """
    if not voxel > 0.0:
        raise ValueError(f"`voxel` is {voxel}, expected a length above 0")
    seen = list(cameras)
    maps = [np.asarray(depth, dtype=np.float32) for depth in depths]
    pictures = [None] * len(seen) if colors is None else [np.asarray(c, dtype=np.float32) for c in colors]
    if not len(seen) == len(maps) == len(pictures):
        raise ValueError(f"{len(seen)} cameras, {len(maps)} depth maps and {len(pictures)} pictures: expected one of each")
    parts = [(c.focal, c.principal, c.cam_from_world, c.center, c.size) for c in seen]
    reach = 5.0 * voxel if truncation is None else truncation
    kept = (most_pieces, least_triangles)
    return Mesh(**_satgs.fuse_depths(list(zip(parts, maps, pictures)), voxel, reach, depth_max, kept, listener(progress)))
