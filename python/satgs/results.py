"""Results of the calls: what the commands print with ``--json``, as frozen dataclasses.

Lengths are metres and errors of images are pixels where a name ends in ``_m`` or ``_px``. A figure that cannot be computed,
for example a mean over no cells, is NaN.
"""

from __future__ import annotations

import dataclasses
import json
import types
import typing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class ViewReport:
    """Statistics of the adjustment of a view.

    Attributes:
        name: Name of the view.
        observations: Number of observations.
        mean_before_px: Mean reprojection error of the delivered camera, pixels.
        mean_px: Mean reprojection error of the corrected camera, pixels.
        rms_px: Root mean square reprojection error of the corrected camera, pixels.
        shift_px: Correction of the shift (columns, rows), corrected minus delivered, pixels.
        shift_sigma_px: Standard deviations of the shift for a given datum, pixels.
        edge_px: Corrections at the edge of the image, pixels: columns by columns, rows by rows, columns by rows, rows by
            columns.
    """

    name: str
    observations: int
    mean_before_px: float
    mean_px: float
    rms_px: float
    shift_px: tuple[float, float]
    shift_sigma_px: tuple[float, float]
    edge_px: tuple[float, float, float, float]


@dataclass(frozen=True)
class ControlReport:
    """Agreement of an observation of a ground control point.

    Attributes:
        view: Name of the view.
        line: Line of the ground control file, from 1.
        residual_px: Reprojection error, pixels.
        moved_m: Adjusted minus surveyed position: east, north, up, metres.
        agrees: Whether the residual is compatible with the standard deviations.
    """

    view: str
    line: int
    residual_px: float
    moved_m: tuple[float, float, float]
    agrees: bool


@dataclass(frozen=True)
class CellReport:
    """Statistics of a cell of ground.

    Attributes:
        id: Column from the west and row from the south: ``x003_y000``.
        center_deg: Longitude and latitude of its middle, degrees.
        tracks: Number of its tracks that survived the adjustment of the whole scene.
        rms_px: Root mean square reprojection error of these, pixels; ``None`` without tracks.
        skipped: Why the cell has no tie points, if it has none.
    """

    id: str
    center_deg: tuple[float, float]
    tracks: int
    rms_px: float | None
    skipped: str | None = None


@dataclass(frozen=True)
class Adjusted:
    """Result of :func:`satgs.adjust`.

    Attributes:
        gauge: What defines the datum.
        rank_defect: Number of independent combinations of corrections that tie points and ground control do not determine;
            3 for a free network, whose translation is undetermined.
        sigma_px: A posteriori standard deviation of an observation, pixels.
        model: Correction of each camera.
        tracks: Number of tracks.
        observations: Number of observations.
        mean_before_px: Mean reprojection error of the delivered cameras, pixels.
        mean_px: Mean reprojection error of the corrected cameras, pixels.
        rms_px: Root mean square reprojection error of the corrected cameras, pixels.
        histogram: Histogram of the reprojection errors (before, after) in bins of 0.05 px; the last holds all larger ones.
        views: Statistics of each view.
        control: Agreement of each observation of a ground control point.
        left_out: Views that could not be adjusted: name and reason. With any the result is partial.
        cells: Statistics of each cell of ground, where a large scene was matched by cells.
        gamma: Display gamma of the images: light = value ** gamma.
        seconds: Time of the adjustment, seconds; ``None`` if its record is missing.
        was_complete: Whether the run folder was adjusted already.
    """

    gauge: str
    rank_defect: int
    sigma_px: float
    model: Literal["shift", "shift-scale", "affine"]
    tracks: int
    observations: int
    mean_before_px: float
    mean_px: float
    rms_px: float
    histogram: tuple[tuple[int, int], ...] = field(repr=False)
    views: tuple[ViewReport, ...]
    control: tuple[ControlReport, ...]
    left_out: tuple[tuple[str, str], ...]
    gamma: float
    seconds: float | None
    was_complete: bool
    cells: tuple[CellReport, ...] = ()


@dataclass(frozen=True)
class Trained:
    """Result of :func:`satgs.train`.

    Attributes:
        iterations: Number of iterations.
        seconds: Time of the iterations, seconds.
        splats_start: Number of splats at the start.
        splats: Number of splats at the end.
        camera_rms_px: Mean over the views of the root mean square distance between camera and RPC, pixels.
        camera_max_px: Largest such distance in any view, pixels.
        l1: Mean absolute difference between rendered and real images (values from 0 to 1); ``None`` without splats.
        ssim: Structural similarity of rendered and real images; ``None`` without splats.
        was_complete: Whether the run was trained already.
    """

    iterations: int
    seconds: float
    splats_start: int
    splats: int
    camera_rms_px: float
    camera_max_px: float
    l1: float | None
    ssim: float | None
    was_complete: bool


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
class RunResult:
    """Result of :func:`satgs.run`.

    Attributes:
        adjusted: Result of the adjustment.
        trained: Result of the training; ``None`` of a scene that is cut into tiles.
        dsm: Result of rendering the surface model; ``None`` of a scene that is cut into tiles.
        mosaic: The mosaic of the tiles; ``None`` of a scene that is trained as a whole.
        evaluation: Scores against the truth; ``None`` without a truth.
        report: The page ``report.html``; ``None`` where there is none.
    """

    adjusted: Adjusted
    trained: Trained | None
    dsm: DsmSummary | None
    mosaic: Mosaicked | None
    evaluation: Evaluation | None
    report: Path | None


def from_json(result: type[T], text: str, **more: object) -> T:
    """An object of a class of this module from JSON, and from values that the JSON does not hold."""
    return typing.cast(T, _made(result, json.loads(text) | more))


def _made(kind: Any, value: Any) -> Any:
    """A value of JSON as an annotated type."""
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        types_of = typing.get_type_hints(kind)
        # Only fields with a default may be missing.
        known = [f.name for f in dataclasses.fields(kind) if f.name in value or f.default is dataclasses.MISSING]
        return kind(**{name: _made(types_of[name], value[name]) for name in known})
    arguments = typing.get_args(kind)
    if typing.get_origin(kind) is tuple:
        of_all = arguments[:1] * len(value) if arguments[-1] is Ellipsis else arguments
        return tuple(_made(item, v) for item, v in zip(of_all, value))
    if isinstance(kind, types.UnionType):
        return None if value is None else _made(arguments[0], value)
    if kind is float:
        return float("nan") if value is None else float(value)
    return Path(value) if kind is Path else value
