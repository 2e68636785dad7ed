"""Results of the tiles of large scenes."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from satgs.results.adjustment import Adjusted
from satgs.results.surface import CellCounts, MapGrid


@dataclass(frozen=True)
class SeamSummary:
    """Differences at the seams between tiles; ``None`` where there is no seam.

    Attributes:
        seams: Number of seams.
        step_m: Median over the seams of the absolute median difference of heights, metres.
        step_p95_m: 95th percentile of the same, metres.
        over_1m: Share of the cells along the seams that differ by more than 1 m.
        ortho_before: Median over the seams of the absolute median difference of grey values, of 255, before colours are
            corrected.
        ortho_after: The same after the correction.
        ortho_spread: Median over the seams of the median absolute difference of grey values in a cell, of 255, after the
            correction.
    """

    seams: int
    step_m: float | None
    step_p95_m: float | None
    over_1m: float | None
    ortho_before: float | None
    ortho_after: float | None
    ortho_spread: float | None


@dataclass(frozen=True)
class FailedTile:
    """A tile that the mosaic lacks.

    Attributes:
        id: ID of the tile.
        reason: Why it failed.
    """

    id: str
    reason: str


@dataclass(frozen=True)
class Mosaicked:
    """The mosaic of the tiles of a large scene.

    Attributes:
        grid: Grid of the rasters.
        cells: Cells with a height, and what their heights rest on.
        tiles: Number of tiles in the mosaic.
        failed: Tiles that are not done: their cores have no data.
        seams: Differences at the seams.
        was_complete: Whether the mosaic was there already.
    """

    grid: MapGrid
    cells: CellCounts
    tiles: int
    failed: tuple[FailedTile, ...]
    seams: SeamSummary
    was_complete: bool


@dataclass(frozen=True)
class PlannedFile:
    """A file that the training of tiles reads.

    Attributes:
        path: The file.
        hash: Hash of its content.
    """

    path: Path
    hash: str


@dataclass(frozen=True)
class TileTraining:
    """How tiles are trained.

    Attributes:
        recipe: Name of the recipe, or its file.
        recipe_hash: Hash of its content.
        iterations: Number of iterations; ``None``: the recipe's own.
        seed: Seed of all random numbers.
        no_splats: Whether to stop at the matched surface.
        predict: Whether training starts from predicted splats.
        snapshots: Number of pictures of the progress.
        features: The network of dense features.
        lpips: The network of the perceptual loss.
    """

    recipe: str
    recipe_hash: str
    iterations: int | None
    seed: int
    no_splats: bool = False
    predict: bool = False
    snapshots: int = 0
    features: PlannedFile | None = None
    lpips: PlannedFile | None = None


@dataclass(frozen=True)
class TileSurface:
    """How the surface models of tiles are rendered.

    Attributes:
        vertical: Vertical reference of the heights; ``None``: the ellipsoid.
        fill_m: Width up to which holes are interpolated, metres.
        vertical_hash: Hash of the file of a geoid grid.
        no_fill: Whether cells that fewer than two views confirm are nodata.
    """

    vertical: str | None
    fill_m: float | None
    vertical_hash: str | None = None
    no_fill: bool = False


@dataclass(frozen=True)
class TileView:
    """A view of a tile.

    Attributes:
        name: Name of the view.
        window: The part of the image that is read: column, row, columns, rows.
        stretch: The stored values that become 0 and 1.
    """

    name: str
    window: tuple[int, int, int, int]
    stretch: tuple[float, float] | None = None


@dataclass(frozen=True)
class TileCost:
    """Predicted cost.

    Attributes:
        seconds_2core: Time on two cores, seconds.
        memory_mb: Memory, megabytes.
        read_mb: What is read of the images, megabytes.
    """

    seconds_2core: float
    memory_mb: float
    read_mb: float


@dataclass(frozen=True)
class Tile:
    """A tile of a plan.

    Attributes:
        id: Its ID.
        core: The ground that it adds to the mosaic: west, south, east, north, metres.
        splat_box: The ground that is trained, likewise.
        heights_m: Lowest and highest height of its tie points.
        searched_m: Lowest and highest height that are searched.
        views: Its views.
        reference: Name of the view whose colours the orthophoto takes.
        neighbours: IDs of its neighbours.
        cost: Its predicted cost.
        input_hash: Hash of all that it is made from.
    """

    id: str
    core: tuple[float, float, float, float]
    splat_box: tuple[float, float, float, float]
    heights_m: tuple[float, float]
    searched_m: tuple[float, float]
    views: tuple[TileView, ...]
    reference: str
    neighbours: tuple[str, ...]
    cost: TileCost
    input_hash: str


@dataclass(frozen=True)
class Plan:
    """The tiles of a scene.

    Attributes:
        schema: Version of the form of the plan.
        satgs: Version of satgs that made it.
        plan_hash: Hash of the plan.
        epsg: EPSG code of the map projection.
        origin_height_m: Height of the origin of altitudes, metres.
        resolution_m: Side of a cell of the surface model, metres.
        train: How tiles are trained.
        surface: How their surface models are rendered.
        adjustment_hash: Hash of the adjustment.
        core_m: Largest side of the core of a tile, metres.
        overlap_m: Width of the ground around a core that is trained as well, metres.
        tiles: The tiles.
        total: Their cost: times and read data of all, memory of the largest.
        was_complete: Whether the plan was there already.
    """

    schema: int
    satgs: str
    plan_hash: str
    epsg: int
    origin_height_m: float
    resolution_m: float
    train: TileTraining
    surface: TileSurface
    adjustment_hash: str
    core_m: float
    overlap_m: float
    tiles: tuple[Tile, ...] = field(repr=False)
    total: TileCost
    was_complete: bool


@dataclass(frozen=True)
class Planned:
    """Result of :func:`satgs.plan`.

    Attributes:
        adjusted: Result of the adjustment.
        plan: The tiles.
    """

    adjusted: Adjusted
    plan: Plan


@dataclass(frozen=True)
class FileSeal:
    """By what a file of a tile is known.

    Attributes:
        bytes: Its size.
        blake3: Hash of its content.
    """

    bytes: int
    blake3: str


@dataclass(frozen=True)
class TileDone:
    """Result of :func:`satgs.tile_run`.

    Attributes:
        input_hash: Hash of all that the tile was made from.
        satgs: Version of satgs that made it.
        seconds: Time, seconds.
        peak_memory_mb: Largest memory, megabytes; ``None`` where the system does not tell.
        splats: Number of splats.
        files: Its files.
        was_complete: Whether the tile was done already.
    """

    input_hash: str
    satgs: str
    seconds: float
    peak_memory_mb: float | None
    splats: int
    files: dict[str, FileSeal]
    was_complete: bool


@dataclass(frozen=True)
class Seam:
    """The seam between two tiles.

    Attributes:
        tiles: IDs of the tiles.
        line: Its ends on the map, metres.
        median_m: Median difference of the heights along it, metres.
        nmad_m: Normalised median absolute deviation of these differences, metres.
        over_1m: Share of the cells that differ by more than 1 m.
        cells: Number of cells along it.
        colors: Pairs of colours along it, as base64 of six bytes a pair.
    """

    tiles: tuple[str, str]
    line: tuple[tuple[float, float], tuple[float, float]]
    median_m: float | None
    nmad_m: float | None
    over_1m: float | None
    cells: int
    colors: str = field(repr=False)


@dataclass(frozen=True)
class Blended:
    """Result of :func:`satgs.tile_blend`.

    Attributes:
        id: ID of the tile.
        input_hash: Hash of all that it was blended from.
        neighbours: IDs of the tiles around, with the tile itself in the middle: rows from the north, columns from the west;
            ``None`` where there is none.
        seams: The seams to the eastern and to the southern neighbour.
        files: Its files.
        was_complete: Whether the tile was blended already.
    """

    id: str
    input_hash: str
    neighbours: tuple[tuple[str | None, ...], ...]
    seams: tuple[Seam, ...]
    files: dict[str, FileSeal]
    was_complete: bool


@dataclass(frozen=True)
class TileStatus:
    """The state of a tile.

    Attributes:
        id: Its ID.
        state: Its state.
        reason: Why it failed, if it did.
        predicted_seconds: Predicted time, seconds.
        seconds: Time that it took.
        predicted_memory_mb: Predicted memory, megabytes.
        peak_memory_mb: Memory that it took.
    """

    id: str
    state: Literal["planned", "running", "done", "failed"]
    reason: str | None
    predicted_seconds: float
    seconds: float | None
    predicted_memory_mb: float
    peak_memory_mb: float | None


@dataclass(frozen=True)
class Status:
    """Result of :func:`satgs.tile_status`.

    Attributes:
        planned: Number of tiles that are to be made.
        running: Number of tiles that are being made.
        done: Number of tiles that are done.
        failed: Number of tiles that failed.
        seconds_left: Predicted time of those that are not done, one after the other.
        tiles: The tiles.
    """

    planned: int
    running: int
    done: int
    failed: int
    seconds_left: float
    tiles: tuple[TileStatus, ...]
