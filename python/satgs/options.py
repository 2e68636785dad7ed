"""Keyword arguments of the calls, as typed dictionaries: one for each part of the work and one for each call.

The calls take them as keywords, ``satgs.train(run, iterations=500)``, or as a dictionary, ``satgs.train(run, **options)`` with
``options: satgs.options.TrainOptions = {"iterations": 500}``. An argument that is ``None`` or absent takes the default of the
command line.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Literal, TypedDict, Union

from satgs.events import Progress

Path = Union[str, PathLike[str]]
"""A path."""


class Reporting(TypedDict, total=False):
    """How the work reports.

    Args:
        progress: Receives the events of the work (:mod:`satgs.events`). ``True`` shows bars of tqdm, which must be installed.
            ``None``: warnings become Python's warnings of the class :class:`SatgsWarning`, everything else is silent.
    """

    progress: Progress | bool | None


class Overwriting(TypedDict, total=False):
    """Whether results are replaced.

    Args:
        overwrite: Compute again, and replace results that are there. ``None``: results of the same input and options are kept,
            and results of others are an error.
    """

    overwrite: bool | None


class SatelliteOptions(TypedDict, total=False):
    """How a scene of satellite images is read.

    Args:
        rpcs: Name of the folder of RPC files beside ``images/``; needed if there are several.
        suns: Azimuth (clockwise from north) and elevation of the sun by view name, degrees, instead of those in files.
        aoi: Area of interest: west, south, east, north in degrees, or a GeoJSON file. ``None``: the ground that at least
            three views see; two, in a scene of two or three views.
        bands: Bands to use, counted from 1: three as red, green, blue, or one. ``None``: those that the file declares as such,
            else the first three.
        stretch_percent: Percentage of pixels to clip at each end of the histogram, from 0 to below 50. ``None``: 0.5; 8-bit
            images: 0.
        gamma: Display gamma of the images, from 1 to 4: radiance = value ** gamma. ``None``: 2.2 for 8-bit images whose shadows
            are bright, too, else 1.
        trust_rpc: Use the first RPC found for an image, even if it seems to belong to another image.
    """

    rpcs: str | None
    suns: Mapping[str, tuple[float, float]] | None
    aoi: tuple[float, float, float, float] | Path | None
    bands: Sequence[int] | None
    stretch_percent: float | None
    gamma: float | None
    trust_rpc: bool | None


class ImageOptions(TypedDict, total=False):
    """Which images of a scene of photographs are read, and how large.

    Args:
        test_views: Test views, which are not trained on: every N-th image, those that a file lists, or ``none``. ``None``: the
            scene's own list, else every 8th.
        downsampling: Reduce images to 1/2, 1/4 or 1/8 of their width and height. ``None``: 1.
        transparent: Meaning of transparent pixels: ``empty``, the background shows, or ``unknown``, they are not compared.
            ``None``: ``empty`` in ``transforms.json``, otherwise ``unknown``.
    """

    test_views: int | Path | None
    downsampling: int | None
    transparent: Literal["empty", "unknown"] | None


class PhotographOptions(ImageOptions, total=False):
    """How a scene of photographs is read.

    Args:
        georef: Where the scene lies on Earth: ``exif``, the GPS positions of the photographs, or a file, JSON with epsg,
            scale, rotation, translation, or lines ``image easting northing height`` after a line ``EPSG:CODE``. ``None``: the
            scene stays in its own frame.
    """

    georef: Path | None


class SceneOptions(SatelliteOptions, PhotographOptions, Reporting, total=False):
    """Keyword arguments of :meth:`satgs.Scene.read`. Those of the other kind of scenes are an error."""


class InfoOptions(SceneOptions, total=False):
    """Keyword arguments of :func:`satgs.info`.

    Args:
        footprints: Write the footprints of the images, at the middle of the height range, to this file (GeoJSON, ``.gpkg``).
        skyplot: Write a plot of the footprints, and a sky plot of satellites and suns, to this file (``.svg``).
        overwrite: Replace files that exist.
    """

    footprints: Path | None
    skyplot: Path | None
    overwrite: bool | None


class AdjustingOptions(TypedDict, total=False):
    """How the cameras of satellite images are adjusted.

    Args:
        model: Correction of each camera. ``None``: ``shift``.
        fixed: Do not correct the cameras: compute tie points, and report how well the cameras agree.
        height_range: Lowest and highest height of tie points and of the surface, metres above the ellipsoid. ``None``: from
            ``dem``, else from the images' metadata, else from the RPCs.
        dem: Elevation model that gives the height range, instead of ``height_range``.
        dem_vertical: Vertical reference of its heights: ``ellipsoid``, ``EGM84``, ``EGM96``, ``EGM2008`` or the file of a geoid
            grid. ``None``: as the file says.
        dem_sigma_m: Tie the height of the scene to the elevation model, with this standard deviation, metres. ``None``: the
            height is that of the delivered RPCs.
        gcps: CSV file of ground control points, which then define the datum; columns
            ``lon,lat,h,image,col,row,sigma_xy_m,sigma_h_m,sigma_px``.
        reference_views: Views whose RPCs are not corrected and define the datum.
    """

    model: Literal["shift", "shift-scale", "affine"] | None
    fixed: bool | None
    height_range: tuple[float, float] | None
    dem: Path | None
    dem_vertical: str | None
    dem_sigma_m: float | None
    gcps: Path | None
    reference_views: Sequence[str] | None


class AdjustOptions(SatelliteOptions, AdjustingOptions, Overwriting, Reporting, total=False):
    """Keyword arguments of :func:`satgs.adjust`."""


class TrainingOptions(TypedDict, total=False):
    """How splats are trained.

    Args:
        recipe: Name of a recipe or a TOML file. For satellite images: ``best`` is for heights, ``baeogs`` and ``eogs`` follow the
            papers, ``satgs`` adds colours for any date and sun, ``satgs-fast`` in a quarter of the iterations. For photographs:
            ``3dgs`` trains ellipsoids, ``2dgs`` flat discs for surfaces, ``indoor`` is for rooms, ``geoprop`` for three to ten
            aerial views. ``None``: ``best``; for photographs ``3dgs``.
        primitive: Kind of splats: ellipsoids or flat discs. ``None``: the recipe's.
        start: Points that training starts from; all but ``predict`` are for photographs. ``None``: the recipe's.
        reference_points: In scenes without points, start from points of the reference depth maps of LEVIR-NVS and ScanNet++.
        iterations: Number of iterations, to which the recipe's schedule is scaled. ``None``: the recipe's own.
        no_splats: Stop at the matched surface: heights, orthophoto, confidence. With two or three images, splats do not change
            the heights; with four and more, training improves them.
        seed: Seed of all random numbers; the same seed gives the same bytes. ``None``: 0.
        device: Device that trains: ``auto``, ``cpu``, ``gpu``, or ``gpu:N``. ``None``: ``auto``.
        checkpoint_every: Number of iterations between checkpoints. ``None``: 500.
        resume: Fail unless there is a checkpoint to continue from.
        snapshots: Number of pictures to write during training, to ``RUN/train/snapshots``. ``None``: 0.
        features: For recipe ``satgs``: ONNX network of image features, such as DINOv2, to find cars and other transient objects.
        lpips: For recipe ``satgs``: network of the perceptual loss, a safetensors file made by ``scripts/fetch-weights``.
        depth_prior: Depth maps of photographs: a folder, an ONNX network, a command with ``{image}`` and ``{out}``, or ``stereo``.
        prior_kind: What the values of ``depth_prior`` are. ``None``: as its ``prior.json`` says, else estimated from the points
            of the scene.
        normal_prior: Normal maps of photographs: a folder, an ONNX network or a command.
        inpaint: Command that paints what no view sees, with ``{rgb}``, ``{mask}``, ``{depth}`` and ``{out}``.
    """

    recipe: Path | None
    primitive: Literal["3d", "2d"] | None
    start: Literal["scene", "patches", "hdd", "gva", "predict"] | None
    reference_points: bool | None
    iterations: int | None
    no_splats: bool | None
    seed: int | None
    device: str | None
    checkpoint_every: int | None
    resume: bool | None
    snapshots: int | None
    features: Path | None
    lpips: Path | None
    depth_prior: Path | None
    prior_kind: Literal["metric", "measured", "relative", "disparity"] | None
    normal_prior: Path | None
    inpaint: str | None


class TrainOptions(TrainingOptions, Overwriting, Reporting, total=False):
    """Keyword arguments of :func:`satgs.train`."""


class SurfaceOptions(TypedDict, total=False):
    """The surface model of a trained run.

    Args:
        resolution_m: Side of a cell, metres; the extent is the trained area. ``None``: 0.5.
        like: Use the grid and extent of this raster.
        vertical: Vertical reference of the heights: ``ellipsoid``, ``EGM84``, ``EGM96``, ``EGM2008`` or the file of a geoid
            grid. ``None``: that of an existing ``RUN/dsm.tif``, else the ellipsoid.
        fill_m: Also interpolate across cells without any height, holes up to this width, metres. ``None``: they stay nodata.
        no_fill: Leave cells that fewer than two views confirm as nodata. ``None``: they are filled in from the cells around
            them, and ``confidence.tif`` has fewer than two views there.
        hillshade: Also write the shaded relief, ``RUN/hillshade.tif``.
        dtm: Also write the bare ground, ``RUN/dtm.tif``, and the heights above it, ``RUN/ndsm.tif``.
        points: Also write the cells as a coloured point cloud (``.laz``, ``.las``); a relative path counts from ``run``.
        mesh: Also write a textured mesh (``.glb``); a relative path counts from ``run``.
    """

    resolution_m: float | None
    like: Path | None
    vertical: str | None
    fill_m: float | None
    no_fill: bool | None
    hillshade: bool | None
    dtm: bool | None
    points: Path | None
    mesh: Path | None


class DsmOptions(SurfaceOptions, Overwriting, Reporting, total=False):
    """Keyword arguments of :func:`satgs.dsm`."""


class TruthOptions(TypedDict, total=False):
    """How a truth is read.

    Args:
        classes: Class raster on the truth's grid, in which 9 is water. ``None``: ``X_CLS.tif`` beside ``X_DSM.tif``, or the
            classes of points.
        mask: Polygons, or a raster on the truth's grid, non-zero inside: inside and outside are scored separately.
        truth_vertical: Vertical reference of the truth's heights: ``ellipsoid``, ``EGM84``, ``EGM96``, ``EGM2008`` or the file
            of a geoid grid. ``None``: as the file says.
        truth_epsg: EPSG code of a point cloud that does not state its own.
    """

    classes: Path | None
    mask: Path | None
    truth_vertical: str | None
    truth_epsg: int | None


class CompareOptions(TruthOptions, Reporting, total=False):
    """Keyword arguments of :func:`satgs.compare`.

    Args:
        confidence: Confidence of the surface model, as :func:`satgs.dsm` writes it, to score confirmed and filled cells
            separately. ``None``: ``confidence.tif`` beside the surface model, if it has the same cells.
        output: Folder for ``metrics.json``, the error map and charts. ``None``: nothing is written.
        overwrite: Replace files of an earlier evaluation.
    """

    confidence: Path | None
    output: Path | None
    overwrite: bool | None


class ChangesOptions(Reporting, total=False):
    """Keyword arguments of :func:`satgs.changes`.

    Args:
        least_height_m: Smallest difference of heights that counts, metres. ``None``: 1.5.
        least_area_m2: Smallest area of a region, square metres. ``None``: 25.
        overwrite: Replace files of an earlier comparison.
    """

    least_height_m: float | None
    least_area_m2: float | None
    overwrite: bool | None


class TilingOptions(TypedDict, total=False):
    """How an area is cut into tiles.

    Args:
        core_m: Largest side of the core of a tile, metres; an area of up to 1.5 times this side is not cut. ``None``: 512.
        overlap_m: Width of the ground around the core that is trained, too, metres; tiles are blended there. ``None``: 32.
        max_memory_mb: Memory that the training of a tile may take, megabytes. ``None``: no limit.
    """

    core_m: float | None
    overlap_m: float | None
    max_memory_mb: float | None


class RunOptions(
    SatelliteOptions,
    PhotographOptions,
    AdjustingOptions,
    TrainingOptions,
    SurfaceOptions,
    TruthOptions,
    TilingOptions,
    Overwriting,
    Reporting,
    total=False,
):
    """Keyword arguments of :func:`satgs.run`. Those of the other kind of scenes are an error.

    Args:
        truth: Score ``dsm.tif`` against this surface model or point cloud.
    """

    truth: Path | None


class PlanOptions(
    SatelliteOptions, AdjustingOptions, TrainingOptions, TilingOptions, Overwriting, Reporting, total=False
):
    """Keyword arguments of :func:`satgs.plan`.

    Args:
        resolution_m: Side of a cell of the surface model, metres. ``None``: 0.5.
        vertical: Vertical reference of the heights. ``None``: the ellipsoid.
        fill_m: Also interpolate across cells without any height, holes up to this width, metres. ``None``: they stay nodata.
        no_fill: Leave cells that fewer than two views confirm as nodata.
    """

    resolution_m: float | None
    vertical: str | None
    fill_m: float | None
    no_fill: bool | None


class TileRunOptions(Reporting, total=False):
    """Keyword arguments of :func:`satgs.tile_run`.

    Args:
        checkpoint_every: Number of iterations between checkpoints. ``None``: 500.
    """

    checkpoint_every: int | None


class TileBlendOptions(Reporting, total=False):
    """Keyword arguments of :func:`satgs.tile_blend`.

    Args:
        without: IDs of neighbours that failed: blend without them.
    """

    without: Sequence[str] | None


class AlignOptions(Reporting, total=False):
    """Keyword arguments of :func:`satgs.align`.

    Args:
        vertical: Vertical reference of the heights of the reference. ``None``: as the file says, else the ellipsoid.
        epsg: EPSG code of a point cloud that does not state its own.
    """

    vertical: str | None
    epsg: int | None


class RenderOptions(Reporting, total=False):
    """Keyword arguments of :func:`satgs.render`. Angles are degrees, azimuths clockwise from north.

    Args:
        like: Use the camera, sun and colours of this view of the run.
        visibility: Write how far other images confirm each pixel of this training view, 0 to 1 (recipe ``satgs``).
        view: Direction of the camera: azimuth and angle off nadir.
        view_to: The same in the last frame.
        appearance: Use the colours of this training view (recipe ``satgs``).
        date: Use the colours of this date, ``YYYY-MM-DD``, and the sun at its ``time`` (recipe ``satgs``).
        date_to: Date of the last frame.
        time: Time of day of ``date``, ``HH:MM`` UTC. ``None``: the median of the training views.
        time_to: Time of day of the last frame, UTC.
        sun: Position of the sun: azimuth and elevation. ``None``: that of ``date``, else of the view, else no shadows.
        sun_to: The same in the last frame.
        size: Columns and rows. ``None``: the trained area in pixels of the reference view.
        depth: Write only the depth (``.tif``).
        normals: Write the unit normals of flat splats (``.tif``).
        frames: Number of frames of an animation: ``OUT.png`` becomes ``OUT_0001.png`` and so on.
        strip: Write the frames side by side into one image.
    """

    like: str | None
    visibility: str | None
    view: tuple[float, float] | None
    view_to: tuple[float, float] | None
    appearance: str | None
    date: str | None
    date_to: str | None
    time: str | None
    time_to: str | None
    sun: tuple[float, float] | None
    sun_to: tuple[float, float] | None
    size: tuple[int, int] | None
    depth: bool | None
    normals: bool | None
    frames: int | None
    strip: bool | None


class NvsEvalOptions(Reporting, total=False):
    """Keyword arguments of :func:`satgs.nvs_eval`.

    Args:
        views: Score these views, even if they were trained on. ``None``: all test views.
        protocol: How the colours of a view are chosen: fitted on the whole image, fitted on its left half, or those of the
            training view taken at the nearest time. ``None``: ``full`` for runs of recipe ``satgs``, else ``half``.
        lpips: Network of the perceptual distance LPIPS, a safetensors file of ``scripts/fetch-weights``.
    """

    views: Sequence[str] | None
    protocol: Literal["full", "half", "nearest"] | None
    lpips: Path | None


class MeshOptions(Reporting, total=False):
    """Keyword arguments of :func:`satgs.mesh`. Defaults depend on the input.

    Args:
        voxel_m: Side of a voxel, metres.
        truncation_m: Truncation distance of the TSDF, metres. ``None``: 4 voxels.
        depth_max_m: Leave out greater depths, metres; not for satellite runs.
        overwrite: Replace the mesh if it exists.
    """

    voxel_m: float | None
    truncation_m: float | None
    depth_max_m: float | None
    overwrite: bool | None


class MeshEvalOptions(Reporting, total=False):
    """Keyword arguments of :func:`satgs.mesh_eval`.

    Args:
        threshold_m: Distance up to which a point counts as correct, metres. ``None``: 0.05.
        views: Cut both meshes to what the views of this run or scene see; it must be in the frame of the reference.
        align: Move the mesh by the similarity that fits the camera centres of this run or scene to those of ``views``.
        error_mesh: Write the mesh coloured by its errors (``.ply``, ``.obj``, ``.glb``).
        overwrite: Replace the error mesh if it exists.
    """

    threshold_m: float | None
    views: Path | None
    align: Path | None
    error_mesh: Path | None
    overwrite: bool | None


class PriorOptions(ImageOptions, Reporting, total=False):
    """Keyword arguments of :func:`satgs.prior`. One of ``model``, ``command`` and ``stereo`` makes the maps.

    Args:
        model: ONNX network that estimates a map from an image.
        command: Command that writes the map ``{out}`` of the image ``{image}``.
        stereo: Match the images with each other at their poses.
        normals: Make normal maps. ``None``: depth maps.
        kind: What the values of depth maps are. ``None``: training estimates it from the points of the scene.
        overwrite: Make all maps again.
    """

    model: Path | None
    command: str | None
    stereo: bool | None
    normals: bool | None
    kind: Literal["metric", "measured", "relative", "disparity"] | None
    overwrite: bool | None


class PredictOptions(PhotographOptions, Overwriting, Reporting, total=False):
    """Keyword arguments of :func:`satgs.predict`.

    Args:
        points: A point cloud (``.laz``, ``.las``, ``.ply``) or a surface model (``.tif``). ``None``: the matched surface of the
            run, else its sparse points; for photographs the points of the scene, else those of its depth maps.
        keep_place: Do not move the points. ``None``: those of satellite scenes are moved onto the tie points.
        model: Model of :func:`satgs.learn`, or an ONNX network. ``None``: the model that comes with satgs; for
            photographs none.
        image_features: ONNX file of the network of image features that the model was trained with.
        without_network: Make a splat of each point without a network, for comparison.
    """

    points: Path | None
    keep_place: bool | None
    model: Path | None
    image_features: Path | None
    without_network: Literal["isotropic", "flat"] | None


class LearnOptions(ImageOptions, Reporting, total=False):
    """Keyword arguments of :func:`satgs.learn`.

    Args:
        start: Model to start from: a file or ``built-in``. With ``scenes`` it is trained further. Without, it is only converted
            to ``out``, for example to ``.onnx`` for other programs.
        scenes: Train a model further on these photographs with depth maps.
        image_features: ONNX network of image features, as further input of the model.
        config: TOML file: numbers of towns, rounds and steps, learning rate, sizes of the network.
    """

    start: Path | None
    scenes: Sequence[Path] | None
    image_features: Path | None
    config: Path | None


class ExportOptions(Reporting, total=False):
    """Keyword arguments of :func:`satgs.export`. One of ``colmap``, ``ply``, ``compressed_ply``, ``spz``, ``gltf`` and
    ``tiles3d`` says what is written.

    Args:
        colmap: Write a COLMAP project into this folder, which must be empty or new.
        format: Files of the COLMAP model. ``None``: ``bin``.
        ply: Write the splats, in the colours of the orthophoto, to this file with all columns of 3DGS.
        compressed_ply: Write the splats to this compressed PLY file of PlayCanvas and SuperSplat.
        variant: Axes of PLY files: z up, or y down. ``None``: ``3dgs``, z up.
        spz: Write the splats to this SPZ file.
        gltf: Write the splats to this ``.glb`` file with ``KHR_gaussian_splatting``.
        compress: Compress the splats of ``gltf`` as SPZ.
        tiles3d: Write 3D Tiles into this folder, which must be empty or new.
        copyright: Copyright notice for ``gltf`` and ``tiles3d``, which globes display.
        overwrite: Replace the file, or what an earlier export wrote into the folder.
    """

    colmap: Path | None
    format: Literal["bin", "text"] | None
    ply: Path | None
    compressed_ply: Path | None
    variant: Literal["3dgs", "y-down"] | None
    spz: Path | None
    gltf: Path | None
    compress: bool | None
    tiles3d: Path | None
    copyright: str | None
    overwrite: bool | None


class SimulateOptions(Reporting, total=False):
    """Keyword arguments of :func:`satgs.simulate`.

    Args:
        seed: Seed of the random town. ``None``: 0.
        room: Photograph a room of 4 x 5 x 2.5 m instead.
        frames: With ``room``: also write RGB-D frames, whose files state this camera.
        aerial: Photograph the town from 600 m above ground instead.
        mountains: Simulate a mountain without buildings instead.
        surface: Simulate images of this surface, a north-up raster of heights in a projected CRS in metres.
        texture: Picture of the ground of ``surface``, in its CRS.
        surface_vertical: Vertical reference of ``surface``. ``None``: as the file says, else the ellipsoid.
        views: Number of images. ``None``: 10; with ``room`` 60, with ``aerial`` 21.
        planned: Take images from these directions, instead of ``views``: off-nadir angle, azimuth and optional time (UTC, as
            ``2024-08-20T10:30``).
        bits: Bits of the grey levels. ``None``: 8; with ``mountains`` 16.
        size_px: Columns and rows of every image.
        gsd_m: Ground sampling distance at nadir, metres. ``None``: 0.5.
        hilly: Put the town on hills.
        seasons: Take images in all four seasons.
        cars_percent: Share of pixels that show a moving car or its shadow, percent, 0 to 8. ``None``: light traffic.
        held_out: Number of additional images, which ``test.txt`` holds back from training. ``None``: 0.
        overwrite: Replace the files of an earlier simulation.
    """

    seed: int | None
    room: bool | None
    frames: Literal["registered", "depth", "color"] | None
    aerial: bool | None
    mountains: bool | None
    surface: Path | None
    texture: Path | None
    surface_vertical: str | None
    views: int | None
    planned: Sequence[tuple[float, float] | tuple[float, float, str]] | None
    bits: int | None
    size_px: int | None
    gsd_m: float | None
    hilly: bool | None
    seasons: bool | None
    cars_percent: float | None
    held_out: int | None
    overwrite: bool | None


class ViewOptions(Reporting, total=False):
    """Keyword arguments of :func:`satgs.view`.

    Args:
        compare: Run to compare with by a divider that is moved across the picture.
        overwrite: Replace the file if it exists.
    """

    compare: Path | None
    overwrite: bool | None


class RpcOptions(Reporting, total=False):
    """Keyword arguments of :func:`satgs.rpc_compare`.

    Args:
        trust_rpc: Use the first RPC found for an image, even if it seems to belong to another image.
    """

    trust_rpc: bool | None


class RpcConvertOptions(RpcOptions, total=False):
    """Keyword arguments of :func:`satgs.rpc_convert`.

    Args:
        image: Image to copy when ``out`` is a ``.tif``.
        overwrite: Replace ``out`` if it exists.
    """

    image: Path | None
    overwrite: bool | None


class RpcFitOptions(RpcOptions, total=False):
    """Keyword arguments of :func:`satgs.rpc_fit`.

    Args:
        size_m: Side of the box on the ground, metres. ``None``: 256.
        heights_m: The box reaches this far above and below its centre, metres. ``None``: 20.
        at: Centre of the box: longitude, latitude, height. ``None``: the centre of the RPC's volume.
    """

    size_m: float | None
    heights_m: float | None
    at: tuple[float, float, float] | None
