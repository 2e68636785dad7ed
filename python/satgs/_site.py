"""The place of a frame on Earth."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Site:
    """A frame on a map: metres east, north and up from an origin.

    Attributes:
        epsg: EPSG code of the map projection.
        origin: Easting, northing and ellipsoidal height of the origin, metres.
    """

    epsg: int
    origin: tuple[float, float, float]

    @classmethod
    def beside(cls, path: str | os.PathLike[str]) -> Site | None:
        """The place that ``NAME.georef.json`` beside a file states; ``None`` without one."""
        georef = Path(path).with_suffix(".georef.json")
        if not georef.is_file():
            return None
        stated = json.loads(georef.read_text(encoding="utf-8"))
        origin = stated["origin"]
        return cls(stated["epsg"], (origin["easting_m"], origin["northing_m"], origin["height_m"]))
