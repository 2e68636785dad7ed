"""The rational polynomial camera; `satgs._satgs` computes."""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import ArrayLike, NDArray

from satgs import _satgs


class Rpc:
    """Rational polynomial camera (RPC00B): the map from the ground to the pixels of a satellite image.

    Columns count right and rows down, in pixels; (0, 0) is the centre of the first pixel. Longitudes and latitudes are
    WGS 84 degrees, heights metres above the WGS 84 ellipsoid. The twenty terms of each polynomial are in the order of
    RPC00B.

    :meth:`read` reads a camera from a file; ``Rpc(text)`` makes one from the text of an RPC file. Cameras are equal that
    have the same coefficients, whatever files they come from. They can be pickled.
    """

    __slots__ = ("_camera",)

    _camera: _satgs.Rpc

    def __init__(self, text: str) -> None:
        """A camera from the text of an RPC file, in any text format that :meth:`read` takes.

        Raises:
            InputError: The text holds no RPC, or a wrong one.
        """
        self._camera = _satgs.Rpc(text)

    @classmethod
    def read(cls, path: str | os.PathLike[str], *, trust_rpc: bool | None = None) -> Rpc:
        """Reads the camera of an RPC file, or of an image with the RPC inside or beside it.

        Formats: ``_RPC.TXT``, Maxar ``.RPB`` and ``.XML``, DIMAP 1 to 3, OSSIM ``.geom``, rpcm JSON, GDAL ``.aux.xml`` and
        VRT, and images (GeoTIFF, NITF and others that GDAL reads).

        Args:
            path: The file.
            trust_rpc: Take the first RPC found for an image even if it seems to belong to another image.

        Raises:
            InputError: The file cannot be read, or no RPC belongs to the image.
        """
        return cls._of(_satgs.Rpc.read(path, trust_rpc=trust_rpc))

    @classmethod
    def _of(cls, camera: _satgs.Rpc) -> Rpc:
        rpc = cls.__new__(cls)
        rpc._camera = camera
        return rpc

    def project(
        self, lon: ArrayLike, lat: ArrayLike, h: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Image positions of ground points.

        Args:
            lon: Longitudes, degrees.
            lat: Latitudes, degrees.
            h: Heights above the ellipsoid, metres.

        The three are numbers or arrays of shapes that broadcast.

        Returns:
            Columns and rows, pixels: two arrays of the common shape. NaN where an argument is NaN.

        Raises:
            ValueError: The shapes do not broadcast.
        """
        return self._camera.project(lon, lat, h)

    def localize(
        self, col: ArrayLike, row: ArrayLike, h: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Ground points that are seen at image positions, at given heights.

        Args:
            col: Columns, pixels.
            row: Rows, pixels.
            h: Heights above the ellipsoid, metres.

        The three are numbers or arrays of shapes that broadcast.

        Returns:
            Longitudes and latitudes, degrees: two arrays of the common shape. They project to within 1e-8 px of the image
            positions, or to within 1e-6 px where rounding allows no better; NaN where no ground point does, as happens far
            outside the image or the height range.

        Raises:
            ValueError: The shapes do not broadcast.
        """
        return self._camera.localize(col, row, h)

    def to_json(self) -> str:
        """The camera as the text of an rpcm JSON file. Reading it gives an equal camera."""
        return self._camera.to_json()

    @property
    def image_offset(self) -> NDArray[np.float64]:
        """Offsets of column and row, pixels: shape (2,)."""
        return self._camera.image_offset

    @property
    def image_scale(self) -> NDArray[np.float64]:
        """Scales of column and row, pixels: shape (2,)."""
        return self._camera.image_scale

    @property
    def ground_offset(self) -> NDArray[np.float64]:
        """Offsets of longitude, latitude (degrees) and height (metres), the centre of the RPC's volume: shape (3,)."""
        return self._camera.ground_offset

    @property
    def ground_scale(self) -> NDArray[np.float64]:
        """Scales of longitude, latitude (degrees) and height (metres), half the sides of the volume: shape (3,)."""
        return self._camera.ground_scale

    @property
    def col_num(self) -> NDArray[np.float64]:
        """Numerator of the column: shape (20,)."""
        return self._camera.col_num

    @property
    def col_den(self) -> NDArray[np.float64]:
        """Denominator of the column: shape (20,)."""
        return self._camera.col_den

    @property
    def row_num(self) -> NDArray[np.float64]:
        """Numerator of the row: shape (20,)."""
        return self._camera.row_num

    @property
    def row_den(self) -> NDArray[np.float64]:
        """Denominator of the row: shape (20,)."""
        return self._camera.row_den

    @property
    def height_range(self) -> tuple[float, float]:
        """Lowest and highest height of the RPC's volume, metres above the ellipsoid."""
        return self._camera.height_range

    @property
    def err_bias_m(self) -> float | None:
        """Root mean square bias error of a horizontal axis, metres; ``None`` if the file does not tell."""
        return self._camera.err_bias_m

    @property
    def err_rand_m(self) -> float | None:
        """Root mean square random error of a horizontal axis, metres; ``None`` if the file does not tell."""
        return self._camera.err_rand_m

    @property
    def format(self) -> str:
        """Name of the format that the camera was read from."""
        return self._camera.format

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is odd about the file, a sentence each."""
        return self._camera.warnings

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Rpc) and self._camera == other._camera

    def __hash__(self) -> int:
        return hash(self.to_json())

    def __repr__(self) -> str:
        return repr(self._camera)

    def __reduce__(self) -> tuple[type[Rpc], tuple[str]]:
        return Rpc, (self.to_json(),)
