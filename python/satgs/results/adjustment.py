"""Results of the adjustment and of the alignment of a run."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal



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
class Shift:
    """A shift, metres.

    Attributes:
        east_m: To the east.
        north_m: To the north.
        up_m: Up.
    """

    east_m: float
    north_m: float
    up_m: float


@dataclass(frozen=True)
class FitQuality:
    """How well points agree with a fit.

    Attributes:
        points: Number of points that were fitted.
        redundancy: Number of measurements beyond those that the unknowns need: without any nothing checks the fit.
        rms_m: Root mean square distance of the points from the fit, metres.
        worst: Of the fitted points the one farthest from the fit, and its distance, metres.
        left_out: Points that disagree with the others and were left out, and their distances, metres; the farthest first.
    """

    points: int
    redundancy: int
    rms_m: float
    worst: tuple[str, float] | None
    left_out: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Coregistration:
    """The shift from a run to a reference.

    Attributes:
        shift: The shift.
        points: Number of points that it was estimated from.
        left_m: Median absolute distance after it, metres.
        sigma_m: Standard deviations east, north and up, metres; ``None`` where nothing determines it.
        directions: Number of horizontal directions that the reference determines, 0 to 2; the shift has no part in others.
        fit: How well surveyed points agree; ``None`` of surfaces.
    """

    shift: Shift
    points: int
    left_m: float
    sigma_m: tuple[float | None, float | None, float | None]
    directions: int
    fit: FitQuality | None


@dataclass(frozen=True)
class Aligned:
    """Result of :func:`satgs.align`.

    Attributes:
        reference: The reference.
        alignment: How everything in the run was moved.
        was_complete: Whether the run was aligned to the reference already, and nothing was moved.
    """

    reference: Path
    alignment: Coregistration
    was_complete: bool
