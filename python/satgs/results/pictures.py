"""Results of renders, meshes, exports and pages."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from satgs.results.adjustment import FitQuality


@dataclass(frozen=True)
class Rendered:
    """Result of :func:`satgs.render`.

    Attributes:
        output: The image; of several frames their common name without the number.
        frames: Number of images.
    """

    output: Path
    frames: int


@dataclass(frozen=True)
class PictureScore:
    """Similarity of a render to an image.

    Attributes:
        psnr_db: Peak signal-to-noise ratio, dB, of colours from 0 to 1.
        ssim: Structural similarity, window of 11 x 11 pixels.
        ssim_3px: The same with a window of 3 x 3 pixels.
        ssim_sat_nerf: What the program of Sat-NeRF prints as SSIM, which mixes pixels and colours: for comparisons with
            publications that used it.
        pixels: Number of scored pixels.
        lpips: Perceptual distance, if a network was given.
    """

    psnr_db: float
    ssim: float
    ssim_3px: float
    ssim_sat_nerf: float
    pixels: int
    lpips: float | None = None


@dataclass(frozen=True)
class SeenScores:
    """Scores of what training views see of a view, and of what they do not see.

    Attributes:
        unseen_share: Share of the pixels that no training view sees.
        unseen_psnr_db: Peak signal-to-noise ratio of these, dB; ``None`` without such pixels.
        seen_psnr_db: That of the others.
    """

    unseen_share: float
    unseen_psnr_db: float | None
    seen_psnr_db: float | None


@dataclass(frozen=True)
class ViewScore:
    """Scores of a view.

    Attributes:
        view: Name of the view.
        score: Its scores.
        parts: Scores of parts that training views see and do not see; ``None`` where these are not told apart.
    """

    view: str
    score: PictureScore
    parts: SeenScores | None = None


@dataclass(frozen=True)
class NvsScores:
    """Result of :func:`satgs.nvs_eval`.

    Attributes:
        views: Scores of each view.
        mean: Their means; ``None`` without views.
        protocol: How the colours of a view were chosen; ``None`` of photographs.
    """

    views: tuple[ViewScore, ...]
    mean: PictureScore | None = None
    protocol: Literal["full", "half", "nearest"] | None = None


@dataclass(frozen=True)
class MeshSummary:
    """Result of :func:`satgs.mesh`.

    Attributes:
        output: The mesh.
        vertices: Number of vertices.
        triangles: Number of triangles.
        pieces: Number of pieces.
        pieces_left_out: Number of small pieces that were left out.
        depth_maps: Number of depth maps that were fused.
        voxel_m: Side of a voxel.
        truncation_m: Truncation distance of the TSDF, metres.
        depth_max_m: Depths beyond this were left out; ``None`` without a limit.
        depths_beyond: Share of the depths that were.
        volume_mb: Memory of the voxels, megabytes.
        epsg: EPSG code of the map on which ``NAME.georef.json`` places the mesh; ``None`` without a place.
    """

    output: Path
    vertices: int
    triangles: int
    pieces: int
    pieces_left_out: int
    depth_maps: int
    voxel_m: float
    truncation_m: float
    depth_max_m: float | None
    depths_beyond: float | None
    volume_mb: float
    epsg: int | None


@dataclass(frozen=True)
class MeshAlignment(FitQuality):
    """The similarity that places a mesh, from the camera centres of the same images.

    Attributes:
        images: Number of images in both.
        scale: Its scale.
        by_attitudes: Whether the attitudes of the cameras were needed, because their centres lie near a line.
    """

    images: int
    scale: float
    by_attitudes: bool


@dataclass(frozen=True)
class MeshEvaluation:
    """Result of :func:`satgs.mesh_eval`.

    Attributes:
        threshold_m: Distance up to which a point counts as correct, metres.
        accuracy_m: Mean distance from the mesh to the reference.
        completeness_m: Mean distance from the reference to the mesh.
        chamfer_m: Mean of both.
        precision: Share of the places of the mesh within the threshold.
        recall: Share of the places of the reference within the threshold.
        f1: Harmonic mean of precision and recall.
        spacing_m: Distances of the places on the mesh and on the reference.
        places: Number of places on the mesh.
        reference_places: Number of places on the reference.
        views: Number of views to what both were cut; ``None`` if they were not.
        alignment: The similarity that places the mesh; ``None`` without.
    """

    threshold_m: float
    accuracy_m: float
    completeness_m: float
    chamfer_m: float
    precision: float
    recall: float
    f1: float
    spacing_m: tuple[float, float]
    places: int
    reference_places: int
    views: int | None
    alignment: MeshAlignment | None


@dataclass(frozen=True)
class ExportedView:
    """A view of an exported COLMAP project.

    Attributes:
        image: Name of the image.
        size: Columns and rows.
        is_test: Whether it is held back.
        distance_m: Distance of the pinhole camera of a satellite view from the ground; ``None`` of photographs.
        rms_px: Root mean square distance between that camera and the RPC, pixels.
        max_px: Largest such distance.
    """

    image: str
    size: tuple[int, int]
    is_test: bool
    distance_m: float | None = None
    rms_px: float | None = None
    max_px: float | None = None


@dataclass(frozen=True)
class ExportedViews:
    """Result of :func:`satgs.export` of a COLMAP project.

    Attributes:
        folder: The folder.
        views: Its views.
        left_out: Views that do not show the area.
        points: Number of points.
        reprojection_px: Mean reprojection error of the points, pixels; ``None`` without observations.
    """

    folder: Path
    views: tuple[ExportedView, ...]
    left_out: tuple[str, ...]
    points: int
    reprojection_px: float | None


@dataclass(frozen=True)
class ExportedSplats:
    """Result of :func:`satgs.export` of splats as one file.

    Attributes:
        file: The file.
        splats: Number of splats.
        bytes: Size of the file.
        step: Distance of neighbouring coordinates, if the format holds whole numbers of it.
    """

    file: Path
    splats: int
    bytes: int
    step: float | None = None


@dataclass(frozen=True)
class ExportedTileset:
    """Result of :func:`satgs.export` of 3D Tiles.

    Attributes:
        tileset: Their document.
        tiles: Number of tiles.
        levels: Number of levels of detail.
        splats: Number of splats of the most detailed level.
        bytes: Size of the files of all tiles.
    """

    tileset: Path
    tiles: int
    levels: int
    splats: int
    bytes: int


@dataclass(frozen=True)
class WrittenPage:
    """Result of :func:`satgs.view`.

    Attributes:
        page: The page.
        bytes: Its size.
        layers: What it shows.
    """

    page: Path
    bytes: int
    layers: tuple[str, ...]
