"""Scenes and their views; `satgs._satgs` reads them."""

from __future__ import annotations

import os
import typing
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from satgs import _satgs
from satgs._arguments import check
from satgs._command_words import listener, words_of
from satgs._pinhole import PinholeCamera
from satgs._raster import Points
from satgs._rpc import Rpc
from satgs._site import Site
from satgs.options import SceneOptions
from satgs.results import Sun

if TYPE_CHECKING:
    from typing_extensions import Unpack


@dataclass(frozen=True, eq=False)
class View:
    """A view of a scene: an image with its camera.

    Attributes:
        name: Name of the image without its extension.
        path: The image file.
        role: Whether the view is trained on.
        size: Columns and rows of the image that :attr:`image` gives.
        camera: Its camera: an :class:`Rpc`, of photographs a :class:`PinholeCamera`, without distortion.
        sun: Position of the sun; ``None`` if it is not known, and of photographs.
        acquired: When the image was taken, UTC, ``YYYY-MM-DDThh:mm:ssZ`` or ``YYYY-MM-DD``; ``None`` if that is not known.
    """

    name: str
    path: Path
    role: Literal["train", "test"]
    size: tuple[int, int]
    camera: Rpc | PinholeCamera
    sun: Sun | None
    acquired: str | None
    _view: _satgs.SceneView = field(repr=False)

    @property
    def image(self) -> NDArray[np.float32]:
        """Colours from 0 to 1, shape (rows, columns, bands); NaN at pixels that are not valid. Each access reads the file.

        Of satellite images the part that is used, its selected bands, stretched as satgs does; of photographs without
        distortion and downsampled, as the camera.

        Raises:
            InputError: The file cannot be read.
        """
        return self._view.image()

    @property
    def depth(self) -> NDArray[np.float32] | None:
        """Depths along the optical axis, shape (rows, columns), NaN where there is none; ``None`` without a depth map.

        Raises:
            InputError: The file cannot be read.
        """
        return self._view.depth()

    def footprint(self, height_m: float) -> NDArray[np.float64] | None:
        """Longitudes and latitudes of the corners of a satellite image at a height, degrees, shape (4, 2); ``None`` of
        photographs."""
        corners = self._view.footprint(height_m)
        return None if corners is None else np.asarray(corners)


@dataclass(frozen=True, eq=False)
class Scene:
    """What a user hands in: views, and what is known of all of them.

    Attributes:
        kind: ``satellite``, or how the files of photographs are arranged.
        views: The views.
        height_range: Lowest and highest height that are searched; ``None`` of photographs.
        gamma: Display gamma of satellite images: light = value ** gamma; ``None`` of photographs.
        points: Points of photographs; ``None`` of satellite images.
        site: Where the frame of photographs stands on Earth; ``None`` if that is not known.
        warnings: What is odd, a sentence each.
    """

    kind: str
    views: tuple[View, ...]
    height_range: tuple[float, float] | None = None
    gamma: float | None = None
    points: Points | None = None
    site: Site | None = None
    warnings: tuple[str, ...] = ()

    @classmethod
    def read(cls, path: str | os.PathLike[str], **options: Unpack[SceneOptions]) -> Scene:
        """Reads a scene of satellite images or of photographs: cameras and metadata; images are read when they are asked for.

        Args:
            path: As for :func:`satgs.info`.
            **options: See :class:`satgs.options.SceneOptions`.

        Raises:
            InputError: The scene or an option is wrong.
        """
        check("Scene.read", typing.get_type_hints(SceneOptions), options)
        words = words_of("info", {"scene": path, **options})[1:]
        views, known = _satgs.read_scene(words, listener(options.get("progress")))
        site = known.get("site")
        points = known.get("points")
        return cls(
            kind=known["kind"],
            views=tuple(map(_view, views)),
            height_range=known.get("height_range"),
            gamma=known.get("gamma"),
            points=None if points is None else Points(points[0], points[1], epsg=None),
            site=None if site is None else Site(*site),
            warnings=tuple(known["warnings"]),
        )

    def __getitem__(self, name: str) -> View:
        """The view of a name."""
        for view in self.views:
            if view.name == name:
                return view
        raise KeyError(f"there is no view `{name}`; there are {', '.join(view.name for view in self.views)}")

    def __len__(self) -> int:
        return len(self.views)


def _view(view: _satgs.SceneView) -> View:
    known = view.describe()
    sun = known.get("sun")
    camera = Rpc._of(known["rpc"]) if "rpc" in known else PinholeCamera(*known["pinhole"])
    return View(
        name=known["name"],
        path=Path(known["path"]),
        role=known["role"],
        size=known["size"],
        camera=camera,
        sun=None if sun is None else Sun(*sun),
        acquired=known.get("acquired"),
        _view=view,
    )
