"""Results of rendering and scoring surface models."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal


@dataclass(frozen=True)
class MapGrid:
    """A north-up grid of square cells.

    Attributes:
        epsg: EPSG code of the projected coordinate system.
        west: Easting of the western edge, metres.
        north: Northing of the northern edge, metres.
        cell: Side of a cell, metres.
        width: Number of columns.
        height: Number of rows.
    """

    epsg: int
    west: float
    north: float
    cell: float
    width: int
    height: int


@dataclass(frozen=True)
class CellCounts:
    """Cells of a surface model by what their heights rest on.

    Attributes:
        all: All cells of the grid.
        with_height: Cells with a height.
        confirmed: Of these, cells that at least two views confirm; ``None`` where views are not counted, of photographs.
        filled: Of these, cells that fewer views confirm: their heights are filled in from the cells around them.
    """

    all: int
    with_height: int
    confirmed: int | None
    filled: int | None


@dataclass(frozen=True)
class DsmSummary:
    """Result of :func:`satgs.dsm`.

    Attributes:
        grid: Grid of the rasters.
        vertical: Name of the vertical reference of the heights, for example ``WGS 84 ellipsoid``.
        cells: Cells with a height, and what their heights rest on.
        was_complete: Whether the surface model was there already.
    """

    grid: MapGrid
    vertical: str
    cells: CellCounts
    was_complete: bool


@dataclass(frozen=True)
class Scores:
    """Statistics of the errors over some cells of land: registered surface model minus truth, metres.

    Attributes:
        mae_m: Mean of the absolute errors.
        rmse_m: Root of the mean of the squared errors.
        bias_m: Mean of the errors.
        median_m: Median of the absolute errors.
        nmad_m: Normalised median absolute deviation: 1.4826 times the median deviation from the median error.
        le90_m: Absolute error that 90 % of the cells do not exceed.
        le95_m: Absolute error that 95 % of the cells do not exceed.
        within: Fractions of the cells with an absolute error of at most 0.5, 1 and 2 m.
        completeness: Predicted cells divided by all cells.
        filled_mae_m: Mean absolute error over all cells after holes are filled with the nearest predicted cell; ``None`` for
            the scores of cells that are filled in.
        cells: Number of cells of land.
        predicted: Number of cells of land that are predicted.
    """

    mae_m: float
    rmse_m: float
    bias_m: float
    median_m: float
    nmad_m: float
    le90_m: float
    le95_m: float
    within: tuple[float, float, float]
    completeness: float
    filled_mae_m: float | None
    cells: int
    predicted: int


@dataclass(frozen=True)
class PartScores(Scores):
    """Scores of a part of the land.

    Attributes:
        by: Criterion of the division.
        name: Name of the part, for example ``6 building``.
    """

    by: Literal["class", "mask", "roof_edge", "slope"]
    name: str


@dataclass(frozen=True)
class RegisteredScores(Scores):
    """A registration of the surface model to the truth, and the scores of all land after it.

    Attributes:
        method: ``z`` adds the median height offset; ``ncc`` shifts by whole cells to the best correlation and adds the mean
            offset; ``xyz`` is the shift in three dimensions with the smallest mean absolute error.
        dx_cells: Columns added to a cell's position before the surface model is sampled.
        dy_cells: Rows added likewise.
        dz_m: Metres added to the heights.
        east_m: Metres that the surface model is moved east.
        north_m: Metres that the surface model is moved north.
        dx_sigma_cells, dy_sigma_cells, dz_sigma_m, east_sigma_m, north_sigma_m: Standard deviations; ``None`` where the heights
            do not tell them, and of methods without a shift.
        is_determined: Whether the heights determine the shift; its part in other directions is 0.
        confirmed: Scores of the cells that at least two views confirm, as if the others were nodata; ``None`` where the numbers
            of views are not known.
        filled: Scores of the other predicted cells, whose heights are filled in from the cells around them.
        breakdown: Scores of parts of the land.
    """

    method: Literal["z", "ncc", "xyz"]
    dx_cells: float
    dy_cells: float
    dz_m: float
    east_m: float
    north_m: float
    dx_sigma_cells: float | None
    dy_sigma_cells: float | None
    dz_sigma_m: float | None
    east_sigma_m: float | None
    north_sigma_m: float | None
    is_determined: bool
    confirmed: Scores | None
    filled: Scores | None
    breakdown: tuple[PartScores, ...] = field(repr=False)


@dataclass(frozen=True)
class ErrorRanking:
    """Expected errors of a surface model compared with the true ones.

    Attributes:
        rank_correlation: Spearman's rank correlation of expected and true absolute errors.
        large_in_least_sure_fifth: Share of the errors above 2 m that lie on the fifth of the cells with the largest expected
            errors; ``None`` without such errors.
        expected_mae_m: Mean of the expected errors, metres.
        cells: Number of cells.
    """

    rank_correlation: float
    large_in_least_sure_fifth: float | None
    expected_mae_m: float
    cells: int


@dataclass(frozen=True)
class Evaluation:
    """Result of :func:`satgs.compare`.

    Attributes:
        prediction: File of the surface model.
        truth: File of the truth.
        grid: Grid of the truth, on which all scores are computed.
        cell_m: Side of a cell of that grid on the ground, metres.
        sampling: How the surface model was resampled to that grid.
        land_cells: Number of cells of the truth that are valid and not water.
        water_cells: Number of cells of water, which are not scored.
        registered_scores: Scores after each registration.
        expected_errors: How well the expected errors of the surface model tell its true ones after registration ``xyz``;
            ``None`` without expected errors.
        notes: Remarks that matter for the interpretation of the scores.
    """

    prediction: Path
    truth: Path
    grid: MapGrid
    cell_m: float
    sampling: Literal["whole_cells", "bilinear", "reprojected"]
    land_cells: int
    water_cells: int
    registered_scores: tuple[RegisteredScores, ...]
    expected_errors: ErrorRanking | None
    notes: tuple[str, ...]

    def after(self, method: Literal["z", "ncc", "xyz"]) -> RegisteredScores:
        """The scores after one registration."""
        return next(scores for scores in self.registered_scores if scores.method == method)


@dataclass(frozen=True)
class Region:
    """A region that changed between two surfaces.

    Attributes:
        area_m2: Area, square metres.
        mean_m: Mean difference of heights, metres: positive where the surface rose.
        largest_m: Difference of heights that is largest in size, metres.
        volume_m3: Volume between the surfaces, cubic metres: positive where the surface rose.
        volume_sigma_m3: Standard deviation of the volume, cubic metres, if the cells of the region err together.
    """

    area_m2: float
    mean_m: float
    largest_m: float
    volume_m3: float
    volume_sigma_m3: float


@dataclass(frozen=True)
class Changes:
    """Result of :func:`satgs.changes`.

    Attributes:
        grid: Grid of the earlier surface, on which the differences lie.
        moved_m: Metres that the later surface was moved east, north and up.
        is_determined: Whether the heights determine the horizontal shift.
        cells: Number of cells of the earlier surface.
        common_cells: Number of cells that both surfaces have.
        notes: What was done to the heights, and what is not known of them.
        sigma_m: Median of the standard deviations of the differences, metres.
        regions: The regions that changed, the largest volume first.
    """

    grid: MapGrid
    moved_m: tuple[float, float, float]
    is_determined: bool
    cells: int
    common_cells: int
    notes: tuple[str, ...]
    sigma_m: float
    regions: tuple[Region, ...]
