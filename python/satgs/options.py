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
        overwrite: Make the results again, whatever is there. ``None``: results of the same input and options are kept, and
            those of others are an error.
    """

    overwrite: bool | None


class SatelliteOptions(TypedDict, total=False):
    """How a scene of satellite images is read.

    Args:
        rpcs: Name of the folder of RPC files beside ``images/``; needed if there are several.
        suns: Azimuth (clockwise from north) and elevation of the sun by view name, degrees, instead of those in files.
        aoi: Area of interest: west, south, east, north in degrees, or a GeoJSON file. ``None``: the ground that at least
            three views see (two, of two or three views).
        bands: Bands to use, counted from 1: three as red, green, blue, or one. ``None``: the first three.
        stretch_percent: Percentage of pixels that is clipped at each end of the values, from 0 to below 50. ``None``: 0.5, and
            0 for 8-bit images.
        gamma: Display gamma of the images, from 1 to 4: light = value ** gamma. ``None``: found from the images: 2.2
            for 8-bit images that are bright in the light and in the shadows, else 1.
        trust_rpc: Take the first RPC found for an image even if it seems to belong to another one.
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
        test_views: Views to hold back for tests: every so many-th image, a file that lists them, or ``none``. ``None``: every
            8th, or the scene's own list.
        downsampling: Use images at 1/2, 1/4 or 1/8 of their size. ``None``: whole images.
        transparent: What transparent pixels mean: nothing is there, or it is unknown what is. ``None``: ``empty`` of
            ``transforms.json``, otherwise ``unknown``.
    """

    test_views: int | Path | None
    downsampling: int | None
    transparent: Literal["empty", "unknown"] | None


class PhotographOptions(ImageOptions, total=False):
    """How a scene of photographs is read.

    Args:
        georef: Where the scene lies on Earth: ``exif``, the GPS positions of the photographs, or a file, JSON with epsg,
            scale, rotation, translation, or lines ``image easting northing height`` after a line ``EPSG:CODE``.
    """

    georef: Path | None


class SceneOptions(SatelliteOptions, PhotographOptions, Reporting, total=False):
    """Keyword arguments of :meth:`satgs.Scene.read`. Those of the other kind of scenes are an error."""


class InfoOptions(SceneOptions, total=False):
    """Keyword arguments of :func:`satgs.info`.

    Args:
        footprints: Write the footprints of the images at the middle of the heights to this file (GeoJSON, ``.gpkg``).
        skyplot: Write a plot of the footprints, satellites and suns to this file (``.svg``).
        overwrite: Replace files that exist.
    """

    footprints: Path | None
    skyplot: Path | None
    overwrite: bool | None


class AdjustingOptions(TypedDict, total=False):
    """How the cameras of satellite images are adjusted.

    Args:
        model: Correction of each camera. ``None``: ``shift``.
        fixed: Keep the cameras as they are, and only measure how well they agree.
        height_range: Lowest and highest height to search, metres above the ellipsoid. ``None``: from ``dem``, else from the
            images' metadata.
        dem: Elevation model that gives the heights to search.
        dem_vertical: Vertical reference of its heights: ``ellipsoid``, ``EGM84``, ``EGM96``, ``EGM2008`` or the file of a geoid
            grid. ``None``: as the file says.
        dem_sigma_m: Standard deviation, metres, with which it constrains the height of the scene. ``None``: it does not.
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
        recipe: Name of a recipe or a TOML file. ``best`` makes heights; ``baeogs`` and ``eogs`` follow the papers; ``satgs``
            adds colours for any date and sun, ``satgs-fast`` in a quarter of the iterations. Of photographs: ``3dgs`` makes
            ellipsoids, ``2dgs`` flat discs for surfaces, ``indoor`` is for rooms, ``geoprop`` for three to ten aerial views.
            ``None``: ``best``, of photographs ``3dgs``.
        primitive: Kind of splats: ellipsoids or flat discs. ``None``: the recipe's.
        start: Points that training starts from; all but ``predict`` are for photographs. ``None``: the recipe's.
        reference_points: Start from points of the reference depth maps, in scenes of photographs without points.
        iterations: Number of iterations, to which the recipe's schedule is scaled. ``None``: the recipe's own.
        no_splats: Stop at the surface that matching finds: no splats are trained. For two or three images the heights are
            those of a run with splats; for more, training makes them better.
        seed: Seed of all random numbers; the same seed gives the same bytes. ``None``: 0.
        device: Device that trains: ``auto``, ``cpu``, ``gpu``, or ``gpu:N``. ``None``: ``auto``.
        checkpoint_every: Number of iterations from one checkpoint to the next. ``None``: 500.
        resume: Fail unless there is a checkpoint to go on from.
        snapshots: Number of pictures of the progress to write to ``RUN/train/snapshots``. ``None``: 0.
        features: For ``satgs``, a network (ONNX) by whose features cars and the like are found.
        lpips: For ``satgs``, a safetensors file of ``scripts/fetch-weights``, for the perceptual loss.
        depth_prior: Depths of photographs: a folder, an ONNX network, a command with ``{image}`` and ``{out}``, or ``stereo``.
        prior_kind: What the values of ``depth_prior`` are. ``None``: as its ``prior.json`` says, else what the points show.
        normal_prior: Surface normals of photographs: a folder, an ONNX network or a command.
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
    """What is rendered of a trained run.

    Args:
        resolution_m: Side of a cell, metres; the extent is the trained area. ``None``: 0.5.
        like: A raster whose grid and extent are taken instead.
        vertical: Vertical reference of the heights: ``ellipsoid``, ``EGM84``, ``EGM96``, ``EGM2008`` or the file of a geoid
            grid. ``None``: that of an existing ``RUN/dsm.tif``, else the ellipsoid.
        fill_m: Interpolate holes up to this width, metres. ``None``: holes stay nodata.
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
        mask: Polygons, or a raster on the truth's grid that is not 0 inside: inside and outside are scored apart.
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
        confidence: Confidence of the surface model, as :func:`satgs.dsm` writes it; with it, cells that two views confirm and
            cells that are filled in are scored apart too. ``None``: ``confidence.tif`` beside the surface model, if it has the
            same cells.
        output: Folder for ``metrics.json``, the error map and figures. ``None``: nothing is written.
        overwrite: Replace files of an earlier evaluation.
    """

    confidence: Path | None
    output: Path | None
    overwrite: bool | None


class ChangesOptions(Reporting, total=False):
    """Keyword arguments of :func:`satgs.changes`.

    Args:
        least_height_m: Smallest difference of heights that counts, metres.
        least_area_m2: Smallest area of a region, square metres.
        overwrite: Replace files of an earlier comparison.
    """

    least_height_m: float | None
    least_area_m2: float | None
    overwrite: bool | None


class TilingOptions(TypedDict, total=False):
    """How an area is cut into tiles.

    Args:
        core_m: Largest side of an area that is trained as a whole, and of the core of a tile, metres.
        overlap_m: Width of the ground around a core that is trained as well, metres; seams are cut there.
        max_memory_mb: Memory that a tile may take, megabytes. ``None``: there is no limit.
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
        truth: A surface model or points to score the result against.
    """

    truth: Path | None


class PlanOptions(
    SatelliteOptions, AdjustingOptions, TrainingOptions, TilingOptions, Overwriting, Reporting, total=False
):
    """Keyword arguments of :func:`satgs.plan`.

    Args:
        resolution_m: Side of a cell of the surface model, metres. ``None``: 0.5.
        vertical: Vertical reference of the heights. ``None``: the ellipsoid.
        fill_m: Interpolate holes up to this width, metres. ``None``: holes stay nodata.
        no_fill: Leave cells that fewer than two views confirm as nodata.
    """

    resolution_m: float | None
    vertical: str | None
    fill_m: float | None
    no_fill: bool | None


class TileRunOptions(Reporting, total=False):
    """Keyword arguments of :func:`satgs.tile_run`.

    Args:
        checkpoint_every: Number of iterations from one checkpoint to the next. ``None``: 500.
    """

    checkpoint_every: int | None


class TileBlendOptions(Reporting, total=False):
    """Keyword arguments of :func:`satgs.tile_blend`.

    Args:
        without: IDs of neighbours that failed, and are left out.
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
        visibility: Write the visibility of the pixels of this training view (recipe ``satgs``).
        view: Direction of the camera: azimuth and angle off nadir.
        view_to: The same in the last frame.
        appearance: The colours of this training view (recipe ``satgs``).
        date: The colours at this date, ``YYYY-MM-DD``, and the sun at its ``time`` (recipe ``satgs``).
        date_to: The date of the last frame.
        time: The time of day of ``date``, ``HH:MM`` UTC. ``None``: the median of the training views.
        time_to: The time of day of the last frame.
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
        truncation_m: Distance from a surface up to which a depth map tells where it is, metres. ``None``: 4 voxels.
        depth_max_m: Leave out depths beyond this, metres; not for satellite runs.
        overwrite: Replace the mesh if it exists.
    """

    voxel_m: float | None
    truncation_m: float | None
    depth_max_m: float | None
    overwrite: bool | None


class MeshEvalOptions(Reporting, total=False):
    """Keyword arguments of :func:`satgs.mesh_eval`.

    Args:
        threshold_m: Distance up to which a place counts as right, metres. ``None``: 0.05.
        views: Run or scene: both meshes are cut to what its views see.
        align: Run or scene whose cameras place the mesh: their centres are moved onto those of ``views``.
        error_mesh: Write the mesh in colours of its errors (``.ply``, ``.obj``, ``.glb``).
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
        model: Network (ONNX) that gives a map of a picture.
        command: Command that writes the map ``{out}`` of the image ``{image}``.
        stereo: Match the images with each other at their poses.
        normals: The maps are of normals. ``None``: of depths.
        kind: What the values of depths are. ``None``: training finds it by the points of the scene.
        overwrite: Make all maps anew.
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
            run, else its sparse points; of photographs the points of the scene, else those of its depth maps.
        keep_place: Take the points where they are. ``None``: those of satellite scenes are moved onto the tie points.
        model: Model of :func:`satgs.learn`, or an ONNX network. ``None``: the model that comes with satgs, of
            photographs none.
        image_features: ONNX file of the network of image features that the model was trained with.
        without_network: Make a splat of each point without a network, to compare with.
    """

    points: Path | None
    keep_place: bool | None
    model: Path | None
    image_features: Path | None
    without_network: Literal["isotropic", "flat"] | None


class LearnOptions(ImageOptions, Reporting, total=False):
    """Keyword arguments of :func:`satgs.learn`.

    Args:
        start: Model to start from: a file or ``built-in``. With ``scenes`` it is trained further. Without, nothing is trained:
            the model is written as ``out``, also as ``.onnx`` for other programs.
        scenes: Train a model further on these scenes of photographs, which have depth maps.
        image_features: ONNX network of features of images, which the model then takes as well.
        config: TOML file of numbers of towns, rounds and steps, learning rate, sizes of the network.
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
        compress: Hold the splats of ``gltf`` as SPZ.
        tiles3d: Write 3D Tiles into this folder, which must be empty or new.
        copyright: Copyright that ``gltf`` and ``tiles3d`` hold and globes show.
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
        room: Photograph a room of 4 x 5 x 2.5 m.
        frames: Of a room, write RGB-D frames too, whose files state this camera.
        aerial: Photograph the town from 600 m above ground.
        mountains: Look at a mountain without buildings.
        surface: Look at this surface, a raster of heights on a map in metres.
        texture: Picture of the ground of ``surface``, in its CRS.
        surface_vertical: Vertical reference of ``surface``. ``None``: as the file says, else the ellipsoid.
        views: Number of images. ``None``: 10, of a room 60, from the air 21.
        planned: Images from these directions instead: angle off nadir, azimuth and, if it is known, time (UTC, as
            ``2024-08-20T10:30``).
        bits: Bits of the grey levels. ``None``: 8, of mountains 16.
        size_px: Columns and rows of every image.
        gsd_m: Ground sampling distance at nadir, metres. ``None``: 0.5.
        hilly: Put the town on hills.
        seasons: Take images in all four seasons.
        cars_percent: Pixels that show a moving car or its shadow, percent, 0 to 8. ``None``: light traffic.
        held_out: Number of more images that ``test.txt`` holds back from training. ``None``: 0.
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
        trust_rpc: Take the first RPC found for an image even if it seems to belong to another one.
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
