"""Rasters and point clouds of runs as arrays; `satgs._satgs` reads them with its own GDAL."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from satgs import _satgs

if TYPE_CHECKING:
    import xarray  # type: ignore[import-not-found, unused-ignore]


@dataclass(frozen=True, eq=False)
class Raster:
    """A raster on a map, or an image.

    ``numpy.asarray(raster)`` gives its values.

    Attributes:
        path: The file.
        values: Shape (rows, columns), or (bands, rows, columns) of several bands. Values of 8 bits are as they are stored; all
            others are float32 with NaN where there is no data.
        transform: GDAL's geotransform: x of the corner of the first pixel, steps of x by column and by row, y of that corner,
            steps of y by column and by row; ``None`` without one.
        crs: The CRS as WKT; empty without one.
        epsg: EPSG code of its horizontal part; ``None`` without one.
        nodata: The nodata value of the file; ``None`` without one.
        bands: Names of the bands, empty where the file has none.
    """

    path: Path
    values: NDArray[Any] = field(repr=False)
    transform: tuple[float, float, float, float, float, float] | None
    crs: str = field(repr=False)
    epsg: int | None
    nodata: float | None
    bands: tuple[str, ...]

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Raster:
        """Reads a raster in any format of GDAL.

        Raises:
            InputError: The file cannot be read.
        """
        values, transform, crs, epsg, nodata, bands = _satgs.read_raster(path)
        return cls(Path(path), values[0] if len(values) == 1 else values, transform, crs, epsg, nodata, tuple(bands))

    @property
    def x(self) -> NDArray[np.float64]:
        """Map coordinates of the centres of the columns of a north-up raster; without a geotransform columns from 0."""
        columns = np.arange(self.values.shape[-1], dtype=np.float64)
        return columns if self.transform is None else self.transform[0] + (columns + 0.5) * self.transform[1]

    @property
    def y(self) -> NDArray[np.float64]:
        """Map coordinates of the centres of the rows of a north-up raster; without a geotransform rows from 0."""
        rows = np.arange(self.values.shape[-2], dtype=np.float64)
        return rows if self.transform is None else self.transform[3] + (rows + 0.5) * self.transform[5]

    def to_xarray(self) -> xarray.DataArray:
        """The raster for xarray, with coordinates ``x``, ``y`` and ``band``, and the CRS as rioxarray has it.

        Raises:
            ImportError: xarray is not installed.
        """
        import xarray

        dims = ("y", "x") if self.values.ndim == 2 else ("band", "y", "x")
        coords: dict[str, Any] = {"x": self.x, "y": self.y}
        if self.values.ndim == 3:
            coords["band"] = np.arange(1, len(self.values) + 1)
        step = " ".join(map(repr, self.transform or ()))
        coords["spatial_ref"] = ((), 0, {"crs_wkt": self.crs, "spatial_ref": self.crs, "GeoTransform": step})
        attributes = {"long_name": self.bands} if any(self.bands) else {}
        return xarray.DataArray(self.values, coords=coords, dims=dims, name=self.path.stem, attrs=attributes)

    def to_rasterio(self) -> Any:
        """The file, opened by rasterio: a ``rasterio.DatasetReader``.

        Raises:
            ImportError: rasterio is not installed.
        """
        return import_module("rasterio").open(self.path)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        array = self.values if dtype is None else self.values.astype(dtype)
        return array.copy() if copy and array is self.values else array


@dataclass(frozen=True, eq=False)
class Points:
    """Points with colours.

    Attributes:
        positions: Shape (n, 3): of satellite scenes easting, northing and ellipsoidal height in metres; of photographs
            coordinates in the frame of the scene.
        colors: Red, green and blue from 0 to 255, shape (n, 3).
        epsg: EPSG code of the map; ``None`` of a frame that is no map.
    """

    positions: NDArray[np.float64] = field(repr=False)
    colors: NDArray[np.uint8] = field(repr=False)
    epsg: int | None

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Points:
        """Reads a LAS or LAZ file, except for points that are withheld or classified as noise.

        Raises:
            InputError: The file cannot be read.
        """
        positions, colors, epsg = _satgs.read_points(path)
        return cls(positions, (colors >> 8).astype(np.uint8), epsg)

    def __len__(self) -> int:
        return len(self.positions)
