"""Gaussian splats as arrays; `satgs._satgs` writes, turns and renders them."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from satgs import _satgs
from satgs._pinhole import PinholeCamera
from satgs._site import Site

SH_C0 = 0.5 / math.sqrt(math.pi)
"""The spherical harmonic of degree 0."""

NEAREST = 0.2
"""Depth up to which nothing is drawn (3DGS)."""


@dataclass(frozen=True, eq=False)
class Picture:
    """What a pinhole camera sees of splats.

    Attributes:
        colors: Red, green and blue from 0 to 1 on black, shape (rows, columns, 3).
        depth: Mean depth of the splats along the optical axis, shape (rows, columns); NaN where less than half of the light is
            held back.
        opacity: Share of the light that the splats hold back, 0 to 1.
        surface_depth: Of flat splats the depth at which half of the light is held back; ``None`` of others.
        normals: Of flat splats their unit normals, shape (rows, columns, 3); ``None`` of others.
    """

    colors: NDArray[np.float32] = field(repr=False)
    depth: NDArray[np.float32] = field(repr=False)
    opacity: NDArray[np.float32] = field(repr=False)
    surface_depth: NDArray[np.float32] | None = field(default=None, repr=False)
    normals: NDArray[np.float32] | None = field(default=None, repr=False)


class Splats:
    """Gaussian splats: a table of float32 with a row for each splat, and the names of its columns, those of 3DGS.

    The attributes ``positions``, ``log_scales``, … are views of the table, without a copy: what is written into them changes the
    splats. A table that was read is mapped from the file, which is not changed. Numbers in a file may stand at any byte:
    ``numpy.require(splats.positions, None, "A")`` makes a copy for programs that need aligned ones.

    Attributes:
        table: Shape (n, columns), float32.
        columns: Names of the columns: ``x``, ``y``, ``z``, ``f_dc_0``, …, ``opacity``, ``scale_0``, …, ``rot_0``, ….
        site: Where the frame of the splats stands on Earth; ``None`` of a frame without a place.
    """

    __slots__ = ("columns", "site", "table")

    table: NDArray[np.float32]
    columns: tuple[str, ...]
    site: Site | None

    def __init__(self, table: NDArray[np.float32], columns: Sequence[str], site: Site | None = None) -> None:
        """Splats of a table.

        Raises:
            ValueError: A column is missing, or the table has another number of columns.
        """
        if table.ndim != 2 or table.shape[1] != len(columns):
            raise ValueError(f"the table has the shape {table.shape}, expected (n, {len(columns)})")
        missing = [name for name in _NEEDED if name not in columns]
        if missing:
            raise ValueError(f"column `{missing[0]}` is missing")
        self.table, self.columns, self.site = table, tuple(columns), site

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Splats:
        """Opens a PLY file of 3DGS or 2DGS. Values are read when they are used.

        Raises:
            InputError: The file cannot be read, or is no such file.
        """
        offset, rows, columns = _satgs.splat_table(path)
        shape = (rows, len(columns))
        # An empty file cannot be mapped.
        table = np.memmap(path, "<f4", "c", offset, shape) if rows else np.zeros(shape, "<f4")
        return cls(table, columns, Site.beside(path))

    def write(self, path: str | os.PathLike[str]) -> None:
        """Writes a PLY file in the form of 3DGS, of flat splats of 2DGS, and where it stands on Earth beside it.

        Raises:
            ValueError: A value is not finite.
            FailedError: The file cannot be written.
        """
        _satgs.write_splats(path, self._groups(), None if self.site is None else (self.site.epsg, self.site.origin))

    @property
    def positions(self) -> NDArray[np.float32]:
        """Centres, shape (n, 3)."""
        return self._of("x", "y", "z")

    @property
    def log_scales(self) -> NDArray[np.float32]:
        """Natural logarithms of the standard deviations along the axes, shape (n, 3), of flat splats (n, 2)."""
        return self._of("scale_0", "scale_1", *(() if self.is_flat else ("scale_2",)))

    @property
    def rotations(self) -> NDArray[np.float32]:
        """Quaternions w, x, y, z of the axes, shape (n, 4); not normalised."""
        return self._of("rot_0", "rot_1", "rot_2", "rot_3")

    @property
    def opacity_logits(self) -> NDArray[np.float32]:
        """Opacities before the logistic function, shape (n,)."""
        return self._of("opacity")[:, 0]

    @property
    def f_dc(self) -> NDArray[np.float32]:
        """Coefficients of degree 0 of the colours, shape (n, 3)."""
        return self._of("f_dc_0", "f_dc_1", "f_dc_2")

    @property
    def f_rest(self) -> NDArray[np.float32] | None:
        """Coefficients above degree 0, channel by channel, shape (n, 9), (n, 24) or (n, 45); ``None`` without."""
        count = sum(name.startswith("f_rest_") for name in self.columns)
        return self._of(*(f"f_rest_{k}" for k in range(count))) if count else None

    @property
    def opacities(self) -> NDArray[np.float32]:
        """Opacities from 0 to 1, shape (n,): a new array."""
        return np.asarray(1.0 / (1.0 + np.exp(-self.opacity_logits)), dtype=np.float32)

    @property
    def scales(self) -> NDArray[np.float32]:
        """Standard deviations along the axes, shape (n, 3), of flat splats (n, 2): a new array."""
        return np.asarray(np.exp(self.log_scales), dtype=np.float32)

    @property
    def colors(self) -> NDArray[np.float32]:
        """Colours without the part that depends on the direction, shape (n, 3), about 0 to 1: a new array."""
        return np.asarray(0.5 + SH_C0 * self.f_dc, dtype=np.float32)

    @property
    def is_flat(self) -> bool:
        """Whether the splats are discs, which have two scales."""
        return "scale_2" not in self.columns

    def structured(self) -> NDArray[Any]:
        """The table as a structured array of shape (n,) with a field for each column; a view where the table is contiguous."""
        dtype = np.dtype([(name, "<f4") for name in self.columns])
        return np.ascontiguousarray(self.table, "<f4").view(dtype)[:, 0]

    def __len__(self) -> int:
        return len(self.table)

    def __getitem__(self, which: slice | NDArray[Any]) -> Splats:
        """The splats of a slice, a mask or indices; of a slice a view."""
        table = self.table[which]
        if table.ndim != 2:
            raise TypeError("one splat is no splats: take a slice, a mask or an array of indices")
        return Splats(table, self.columns, self.site)

    def crop(self, low: ArrayLike, high: ArrayLike) -> Splats:
        """The splats whose centres lie in a box, from its lowest to its highest corner (x, y, z)."""
        inside = (self.positions >= np.asarray(low)) & (self.positions <= np.asarray(high))
        return self[np.asarray(inside.all(axis=1))]

    def transform(
        self, scale: float = 1.0, rotation: ArrayLike | None = None, translation: ArrayLike = (0.0, 0.0, 0.0)
    ) -> Splats:
        """The splats in another frame, ``scale * rotation * p + translation``: positions, sizes, attitudes, and colours that
        depend on the direction of view. The new frame has no place on Earth.

        Args:
            scale: Scale, above 0.
            rotation: Rotation, shape (3, 3). ``None``: none.
            translation: Translation, shape (3,).

        Raises:
            ValueError: The scale is not above 0, or the matrix is no rotation.
        """
        turn = np.eye(3) if rotation is None else np.asarray(rotation, dtype=np.float64)
        is_rotation = turn.shape == (3, 3) and np.allclose(turn @ turn.T, np.eye(3), atol=1e-6)
        if not (is_rotation and np.linalg.det(turn) > 0.0):
            raise ValueError("`rotation` is no rotation: its rows must be orthogonal unit vectors, right-handed")
        if not (math.isfinite(scale) and scale > 0.0):
            raise ValueError(f"`scale` is {scale!r}, expected a number above 0")
        shift = np.asarray(translation, dtype=np.float64)
        moved = _satgs.transform_splats(self._groups(), scale, turn.tolist(), shift.tolist())
        out = Splats(np.array(self.table), self.columns)
        out.positions[:] = moved["position"]
        out.f_dc[:] = moved["f_dc"]
        out.log_scales[:] = moved["log_scale"][:, : out.log_scales.shape[1]]
        out.rotations[:] = moved["rotation"]
        rest = moved["f_rest"]
        if rest is not None and out.f_rest is not None:
            of_channel = out.f_rest.shape[1] // 3
            out.f_rest[:] = rest.reshape(-1, 3, 15)[:, :, :of_channel].reshape(len(out), -1)
        return out

    def render(self, camera: PinholeCamera, nearest: float = NEAREST) -> Picture:
        """The picture that a camera in the frame of the splats sees, in the colours of the file.

        Args:
            camera: The camera.
            nearest: Depth up to which nothing is drawn.

        Raises:
            ValueError: A value of a splat is not finite, or the camera has no pixels.
        """
        c = camera
        seen = _satgs.render_splats(self._groups(), (c.focal, c.principal, c.cam_from_world, c.center, c.size), nearest)
        return Picture(**seen)

    def __repr__(self) -> str:
        kind = "flat splats" if self.is_flat else "splats"
        place = f", EPSG:{self.site.epsg}" if self.site is not None else ""
        return f"<satgs.Splats: {len(self)} {kind}, {len(self.columns)} columns{place}>"

    def _of(self, *names: str) -> NDArray[np.float32]:
        """Columns as a view, which they are where they stand in a row; 3DGS orders them so."""
        places = [self.columns.index(name) for name in names]
        if places == list(range(places[0], places[0] + len(places))):
            return self.table[:, places[0] : places[-1] + 1]
        raise ValueError(f"the columns {', '.join(names)} do not stand in a row")

    def _groups(self) -> dict[str, NDArray[np.float32] | None]:
        """The parameters for the extension module, which needs aligned numbers: those of a mapped file may stand anywhere."""

        def aligned(values: NDArray[np.float32]) -> NDArray[np.float32]:
            return np.require(values, np.float32, ["A"])

        rest = self.f_rest
        return {
            "position": aligned(self.positions),
            "f_dc": aligned(self.f_dc),
            "f_rest": None if rest is None else aligned(rest),
            "opacity_logit": aligned(self.opacity_logits[:, None]),
            "log_scale": aligned(self.log_scales),
            "rotation": aligned(self.rotations),
        }


_NEEDED = ("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "rot_0", "rot_1", "rot_2", "rot_3")
