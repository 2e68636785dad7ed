"""What scenes and cameras are."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from satgs._site import Site
from satgs.results.adjustment import FitQuality


@dataclass(frozen=True)
class Sun:
    """The position of the sun, degrees.

    Attributes:
        azimuth_deg: Clockwise from north.
        elevation_deg: Above the horizon.
    """

    azimuth_deg: float
    elevation_deg: float


@dataclass(frozen=True)
class SatelliteView:
    """What is known of a satellite view.

    Attributes:
        name: Name of the view.
        image: The image file.
        width: Columns of what is used of the image.
        height: Rows of what is used of the image.
        bands: Number of bands of the file.
        bits: Number of bits of a value.
        role: Whether the view is trained on.
        values: Lowest and highest value; ``None`` without valid pixels.
        median_value: Their median.
        valid_percent: Pixels that are image, percent.
        black_margin_percent: Of these the black ones along the border, if they are many.
        gsd_col_m: Ground sampling distance along columns.
        gsd_row_m: Ground sampling distance along rows.
        off_nadir_deg: Angle between the vertical and the satellite.
        azimuth_deg: Azimuth of the satellite.
        sun: Position of the sun, if it is known.
        acquired: When the image was taken, UTC, if it is known.
        rpc_source: Where the RPC was found.
        rpc_heights_m: Lowest and highest height of the RPC's volume.
        height_range_m: Heights of the ground, from the metadata of the product.
        footprint: Longitudes and latitudes of the corners, degrees.
        footprint_m2: Area of the footprint.
        most_shared_percent: Share of it that the view has in common with the view that shares most.
    """

    name: str
    image: Path
    width: int
    height: int
    bands: int
    bits: int
    role: Literal["train", "test"]
    values: tuple[float, float] | None
    median_value: float | None
    valid_percent: float
    black_margin_percent: float | None
    gsd_col_m: float | None
    gsd_row_m: float | None
    off_nadir_deg: float | None
    azimuth_deg: float | None
    sun: Sun | None
    acquired: str | None
    rpc_source: str
    rpc_heights_m: tuple[float, float]
    height_range_m: tuple[float, float] | None
    footprint: tuple[tuple[float, float], ...] | None
    footprint_m2: float
    most_shared_percent: float | None


@dataclass(frozen=True)
class SearchedHeights:
    """The heights that are searched.

    Attributes:
        low_m: The lowest, metres above the ellipsoid.
        high_m: The highest.
        source: What says so.
    """

    low_m: float
    high_m: float
    source: Literal["option", "elevation_model", "metadata", "rpcs", "tie_points"]


@dataclass(frozen=True)
class Pair:
    """The convergence angle of two views.

    Attributes:
        a: One view.
        b: The other one.
        deg: The angle between their lines of sight, degrees.
    """

    a: str
    b: str
    deg: float


@dataclass(frozen=True)
class Convergence:
    """Convergence angles of all pairs; ``None`` without two views.

    Attributes:
        min_deg: The smallest.
        median_deg: The median.
        max_deg: The largest.
        pairs: All pairs, the smallest angle first.
    """

    min_deg: float | None
    median_deg: float | None
    max_deg: float | None
    pairs: tuple[Pair, ...] = field(repr=False)


@dataclass(frozen=True)
class Ground:
    """What views show of the ground.

    Attributes:
        epsg: EPSG code of the UTM zone.
        height_m: Height of the footprints.
        min_views: Number of views that must see the common ground.
        common_m2: Area that so many views see.
        all_views_m2: Area that all views see.
        common_box: West, south, east and north of the common ground on the map, metres; ``None`` without any.
    """

    epsg: int
    height_m: float
    min_views: int
    common_m2: float
    all_views_m2: float
    common_box: tuple[float, float, float, float] | None


@dataclass(frozen=True)
class SatelliteInfo:
    """Result of :func:`satgs.info` for satellite images.

    Attributes:
        views: The views.
        gamma: Display gamma of the images: light = value ** gamma.
        heights_searched: The heights that are searched.
        convergence: Convergence angles.
        ground: What the views show of the ground.
        warnings: What is odd about the scene, a sentence each.
    """

    views: tuple[SatelliteView, ...]
    gamma: float
    heights_searched: SearchedHeights
    convergence: Convergence
    ground: Ground
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Photograph:
    """What is known of a photograph.

    Attributes:
        name: Name of the view.
        image: The image file.
        role: Whether the view is trained on.
        model: Name of the lens model.
        width: Columns of the image file.
        height: Rows of the image file.
        focal_px: Focal lengths, pixels.
        center: Position of the camera in the frame of the scene.
        masks: Masks of the image.
        depth: The depth map, if there is one.
    """

    name: str
    image: Path
    role: Literal["train", "test"]
    model: str
    width: int
    height: int
    focal_px: tuple[float, float]
    center: tuple[float, float, float]
    masks: tuple[Path, ...]
    depth: Path | None


@dataclass(frozen=True)
class Lens:
    """The cameras of one lens model.

    Attributes:
        model: Name of the model.
        views: Number of views.
        cameras: Number of cameras.
        focal_px: Smallest and largest focal length, pixels.
        distortion_px: Largest distortion, pixels; ``None`` where it has no inverse in parts of the image.
    """

    model: str
    views: int
    cameras: int
    focal_px: tuple[float, float]
    distortion_px: float | None


@dataclass(frozen=True)
class Reprojection:
    """Reprojection errors of the points of a COLMAP model.

    Attributes:
        observations: Number of observations.
        mean_px: Mean error, pixels.
        stated_px: The mean that the file states.
    """

    observations: int
    mean_px: float
    stated_px: float | None


@dataclass(frozen=True)
class PositionFit(FitQuality):
    """How GPS positions of photographs place a scene.

    Attributes:
        tilt_sigma_deg: Standard deviation of its tilt.
        heading_sigma_deg: Standard deviation of its heading.
        prior: What is known of the attitude beside the positions.
        without_fix: Photographs without a position.
        warnings: What is uncertain, a sentence each.
    """

    tilt_sigma_deg: float
    heading_sigma_deg: float
    prior: str | None
    without_fix: tuple[str, ...]
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Georeference:
    """Where a scene lies on Earth: ``site = scale * rotation * scene + translation``.

    Attributes:
        grid: The site frame.
        scale: Metres for a unit of the scene.
        rotation: Rotation, row by row.
        translation: Translation, metres.
        fit: How positions of photographs agree; ``None`` of a file.
    """

    grid: Site
    scale: float
    rotation: tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
    translation: tuple[float, float, float]
    fit: PositionFit | None


@dataclass(frozen=True)
class Transparent:
    """Transparent pixels of images.

    Attributes:
        images: Number of images that have some.
        meaning: What they mean.
    """

    images: int
    meaning: Literal["empty", "unknown"]


@dataclass(frozen=True)
class ColorRegistration:
    """The colour camera of RGB-D frames, where it is another one than that of the depth maps.

    Attributes:
        focal_ratio: Focal length of the colours over the stated one.
        depth_focal_ratio: Focal length of the depth maps over the stated one.
        offset_m: Position of the depth camera beside the colour camera.
        edges: Strength of the images' edges at jumps of the depths, before and after.
        epipolar_px: Median distance of matched features from their epipolar lines, before and after.
        carried_px: Median distance of matched features from where depths carry them, before and after.
    """

    focal_ratio: float
    depth_focal_ratio: float
    offset_m: tuple[float, float]
    edges: tuple[float, float]
    epipolar_px: tuple[float, float] | None = None
    carried_px: tuple[float, float] | None = None


@dataclass(frozen=True)
class RejectedRegistration:
    """Two cameras of RGB-D frames that edges suggest and matched features contradict.

    Attributes:
        focal_ratio: Focal length of the colours over that of the depth maps.
        edges: As of :class:`ColorRegistration`.
        epipolar_px: As of :class:`ColorRegistration`.
        carried_px: As of :class:`ColorRegistration`.
    """

    focal_ratio: float
    edges: tuple[float, float]
    epipolar_px: tuple[float, float] | None = None
    carried_px: tuple[float, float] | None = None


@dataclass(frozen=True)
class PoseFinding:
    """What photographs say against their cameras; which fields there are depends on the kind.

    Attributes:
        kind: ``convention``: poses are to be read in another way; ``focal``: all focal lengths are wrong by a factor;
            ``inaccurate``: most poses do not fit; ``exchanged``: two images fit the poses of each other; ``misplaced``: one view does
            not fit; ``unmatched``: one view shows nothing that the others show.
        reading: How poses are to be read.
        factor: Focal length that fits over the stated one.
        px: Median distance from epipolar lines, pixels; as stated and in the other way where there is one.
        agree: Share of the pairs of views that agree, likewise.
        views: Names of the exchanged views.
        view: Name of the view.
        compared: Number of views that it was compared with.
    """

    kind: Literal["convention", "focal", "inaccurate", "exchanged", "misplaced", "unmatched"]
    reading: str | None = None
    factor: float | None = None
    px: tuple[float, float] | float | None = None
    agree: tuple[float, float] | float | None = None
    views: tuple[str, str] | None = None
    view: str | None = None
    compared: int | None = None


@dataclass(frozen=True)
class ViewResidual:
    """How far the matched features of a view lie from epipolar lines.

    Attributes:
        view: Its name.
        median_px: Median distance, pixels.
    """

    view: str
    median_px: float


@dataclass(frozen=True)
class PoseCheck:
    """How well the cameras of photographs fit them.

    Attributes:
        views: Number of views that were looked at.
        pairs: Number of pairs of views with matched features.
        matches: Number of matched features.
        median_px: Median distance from epipolar lines, pixels; ``None`` without matches.
        worst: The view with the largest distance.
        findings: What the photographs say against the cameras.
    """

    views: int
    pairs: int
    matches: int
    median_px: float | None
    worst: ViewResidual | None
    findings: tuple[PoseFinding, ...]


@dataclass(frozen=True)
class SplatFileInfo:
    """Result of :func:`satgs.info` for a file of splats.

    Attributes:
        format: Its format.
        splats: Number of splats.
        primitive: Kind of the splats.
        degree: Highest degree of spherical harmonics that is not zero.
        axes: Directions of x, y and z.
        bounds: Corners of the box around the centres, in the axes and the unit of the file.
        site: The frame of the coordinates, if it is known.
        map_bounds: Corners of that box on the map: easting, northing, ellipsoidal height.
    """

    format: str
    splats: int
    primitive: str
    degree: int
    axes: tuple[str, str, str]
    bounds: tuple[tuple[float, float, float], tuple[float, float, float]] | None
    site: Site | None
    map_bounds: tuple[tuple[float, float, float], tuple[float, float, float]] | None


@dataclass(frozen=True)
class TilesetInfo:
    """Result of :func:`satgs.info` for 3D Tiles.

    Attributes:
        version: Version of 3D Tiles.
        tiles: Number of tiles.
        levels: Number of levels of detail.
        error_m: Error of the coarsest level, metres.
        origin_ecef: Earth-centred coordinates of the origin, metres.
        copyright: To whom it is credited.
    """

    version: str
    tiles: int
    levels: int
    error_m: float
    origin_ecef: tuple[float, float, float] | None
    copyright: str | None


@dataclass(frozen=True)
class PhotographsInfo:
    """Result of :func:`satgs.info` for photographs.

    Attributes:
        layout: How the files are arranged.
        train: Number of views to train on.
        test: Number of views that are held back.
        cameras: The cameras by lens model.
        views: The views.
        points: Number of points.
        reprojection: Reprojection errors; ``None`` where the scene has no observations.
        extent: Lowest and highest coordinates of points and cameras; ``None`` without any.
        georeference: Where the scene lies; ``None`` if that is not known.
        skipped: Images and files that were left out, and why.
        unused: Keys and files that are not used, and why.
        transparent: Transparent pixels; ``None`` without any.
        registration: The cameras of RGB-D frames that are two.
        rejected_registration: Two cameras that edges suggest and features contradict.
        poses: How well the cameras fit the photographs.
    """

    layout: Literal["colmap", "transforms", "rgb-d", "levir", "scannet++"]
    train: int
    test: int
    cameras: tuple[Lens, ...]
    views: tuple[Photograph, ...]
    points: int
    reprojection: Reprojection | None
    extent: tuple[tuple[float, float, float], tuple[float, float, float]] | None
    georeference: Georeference | None
    skipped: tuple[tuple[str, str], ...]
    unused: tuple[tuple[str, str], ...]
    transparent: Transparent | None
    registration: ColorRegistration | None
    rejected_registration: RejectedRegistration | None
    poses: PoseCheck


@dataclass(frozen=True)
class Residual:
    """Distances of a simpler camera from an RPC over a box.

    Attributes:
        rms_px: Root mean square distance, pixels.
        max_px: Largest distance.
    """

    rms_px: float
    max_px: float


@dataclass(frozen=True)
class RpcFit:
    """Result of :func:`satgs.rpc_fit`.

    Attributes:
        center: Centre of the box: longitude, latitude, height.
        size_m: Its side on the ground.
        heights_m: How far it reaches above and below its centre.
        affine: Distance of the affine camera.
        quadratic: Distance of the camera with a quadratic term.
    """

    center: tuple[float, float, float]
    size_m: float
    heights_m: float
    affine: Residual
    quadratic: Residual


@dataclass(frozen=True)
class RpcDifference:
    """Result of :func:`satgs.rpc_compare`: differences over the volume of the first camera, pixels.

    Attributes:
        rms_px: Root mean square distance.
        max_px: Largest distance.
        mean_col_px: Mean column of the second camera minus that of the first.
        mean_row_px: Mean row likewise.
        points: Number of compared points.
    """

    rms_px: float
    max_px: float
    mean_col_px: float
    mean_row_px: float
    points: int


@dataclass(frozen=True)
class ConvertedRpc:
    """Result of :func:`satgs.rpc_convert`.

    Attributes:
        out: The file that was written.
        source: Name of the format that was read; ``from`` in JSON.
        to: Ending of the file, which sets its format.
    """

    out: Path
    source: str = field(metadata={"key": "from"})
    to: str
