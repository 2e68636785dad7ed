"""Results of simulations."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal


@dataclass(frozen=True)
class SceneFigures:
    """Figures of simulated ground.

    Attributes:
        mean_absolute_deviation_m: Mean absolute deviation of the heights.
        roofs_share: Share of roofs.
        trees_share: Share of trees.
        water_share: Share of water.
        tallest_building_m: Height of the tallest building.
        relief_m: Difference between the highest and the lowest ground.
    """

    mean_absolute_deviation_m: float
    roofs_share: float
    trees_share: float
    water_share: float
    tallest_building_m: float
    relief_m: float


@dataclass(frozen=True)
class SurfaceFigures:
    """Figures of a surface that was imaged.

    Attributes:
        vertical: Name of the vertical reference of its heights.
        vertical_is_assumed: Whether nothing states it.
        holes_share: Share without heights.
        untextured_share: Share without texture.
    """

    vertical: str
    vertical_is_assumed: bool
    holes_share: float
    untextured_share: float


@dataclass(frozen=True)
class AppearanceFigures:
    """What makes an image differ from others of the place.

    Attributes:
        gain: Gains of red, green and blue.
        offset: Offsets by haze.
        noise: Standard deviation of the noise.
        grass: Mean colour of grass.
        trees: Mean colour of trees.
        snow: Share of open ground with snow.
        cars_percent: Pixels with cars and their shadows, percent.
        sunlit: Picture of the share of sunlight.
        cars: Picture of cars.
        clean: The image without cars and noise.
    """

    gain: tuple[float, float, float]
    offset: tuple[float, float, float]
    noise: float
    grass: tuple[float, float, float]
    trees: tuple[float, float, float]
    snow: float
    cars_percent: float
    sunlit: Path
    cars: Path
    clean: Path


@dataclass(frozen=True)
class SimulatedView:
    """A simulated satellite image.

    Attributes:
        name: Name of the view.
        role: Whether it is held back.
        off_nadir_deg: Angle between the vertical and the satellite.
        azimuth_deg: Azimuth of the satellite.
        sun_azimuth_deg: Azimuth of the sun.
        sun_elevation_deg: Elevation of the sun.
        acquired: Date and time, UTC.
        d_col: Pointing error of its RPC, columns.
        d_row: Pointing error of its RPC, rows.
        appearance: What makes it differ from others; ``None`` where nothing was asked for.
    """

    name: str
    role: Literal["train", "test"]
    off_nadir_deg: float
    azimuth_deg: float
    sun_azimuth_deg: float
    sun_elevation_deg: float
    acquired: str
    d_col: float
    d_row: float
    appearance: AppearanceFigures | None


@dataclass(frozen=True)
class SimulatedScene:
    """Satellite images that were simulated.

    Attributes:
        scene: Figures of the ground.
        surface: Figures of the surface that was imaged; ``None`` of a town or mountain.
        views: The images.
        truth: The exact surface model.
    """

    scene: SceneFigures
    surface: SurfaceFigures | None
    views: tuple[SimulatedView, ...]
    truth: Path


@dataclass(frozen=True)
class DisparityMap:
    """The map from inverse depths to the values of a disparity map.

    Attributes:
        scale: Value for an inverse metre.
        offset: Value at infinity.
    """

    scale: float
    offset: float


@dataclass(frozen=True)
class SimulatedPhotograph:
    """A simulated photograph.

    Attributes:
        name: Name of the view.
        role: Whether it is held back.
        center: Position of the camera, metres.
        depths_m: Smallest and largest depth.
        points: Number of points that it sees.
        disparity: The map of its inverse depths to ``priors/depths``.
    """

    name: str
    role: Literal["train", "test"]
    center: tuple[float, float, float]
    depths_m: tuple[float, float]
    points: int
    disparity: DisparityMap


@dataclass(frozen=True)
class SimulatedPhotographs:
    """Photographs that were simulated.

    Attributes:
        views: The photographs.
        points: Number of points of the COLMAP model.
        mesh_vertices: Number of vertices of the exact mesh.
        mesh_triangles: Number of its triangles.
        mesh: The exact mesh.
        test_list: List of the photographs that are held back, if there is one.
    """

    views: tuple[SimulatedPhotograph, ...]
    points: int
    mesh_vertices: int
    mesh_triangles: int
    mesh: Path
    test_list: Path | None


@dataclass(frozen=True)
class Simulated:
    """Result of :func:`satgs.simulate`.

    Attributes:
        out: Folder of the scene.
        options: All options, also those that were not given, as in the JSON of the command.
        summary: What was made.
    """

    out: Path
    options: dict[str, Any]
    summary: SimulatedScene | SimulatedPhotographs
