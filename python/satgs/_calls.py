"""The calls: keyword arguments in, an object of `satgs.results` out. `satgs._satgs` does the work.

An argument that is ``None`` takes the default of the library, which is also that of the command line. Each call hands all its
arguments (`locals()` before any other name exists) to the extension module, which takes those that it knows by name.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Literal, TypeVar

from satgs import _satgs, events
from satgs._arguments import check
from satgs.errors import FailedError, SatgsWarning
from satgs.events import Event, Progress
from satgs.results import Adjusted, DsmSummary, Evaluation, Mosaicked, RunResult, Trained, from_json

PathLike = str | os.PathLike[str]
T = TypeVar("T")


def adjust(
    scene: PathLike,
    run: PathLike,
    *,
    rpcs: str | None = None,
    suns: Mapping[str, tuple[float, float]] | None = None,
    aoi: tuple[float, float, float, float] | PathLike | None = None,
    bands: Sequence[int] | None = None,
    stretch_percent: float | None = None,
    gamma: float | None = None,
    trust_rpc: bool | None = None,
    model: Literal["shift", "shift-scale", "affine"] | None = None,
    fixed: bool | None = None,
    height_range: tuple[float, float] | None = None,
    dem: PathLike | None = None,
    dem_vertical: str | None = None,
    dem_sigma_m: float | None = None,
    gcps: PathLike | None = None,
    reference_views: Sequence[str] | None = None,
    overwrite: bool | None = None,
    progress: Progress | None = None,
) -> Adjusted:
    """Corrects the RPC cameras of a scene by bundle adjustment: writes ``RUN/scene.json`` and ``RUN/ba``.

    ``RUN/ba`` gets the corrected RPCs, tie points, sparse points and a report. An adjustment that the run folder holds
    already, of the same input and options, is kept.

    Args:
        scene: Folder of images with RPCs, a folder with ``images/`` and folders of RPC files, or a list of views (TOML, STAC).
        run: The run folder.
        rpcs: Name of the folder of RPC files beside ``images/``; needed if there are several.
        suns: Azimuth (clockwise from north) and elevation of the sun by view name, degrees, instead of those in files.
        aoi: Area of interest: west, south, east, north in degrees, or a GeoJSON file. ``None``: the ground that at least
            three views see (two, of two or three views).
        bands: Bands to use, counted from 1: three as red, green, blue, or one. ``None``: the first three.
        stretch_percent: Percentage of pixels that is clipped at each end of the values, from 0 to below 50. ``None``: 0.5, and 0
            for 8-bit images.
        gamma: Display gamma of the images, from 1 to 4: light = value ** gamma. ``None``: found from the images: 2.2
            for 8-bit images that are bright in the light and in the shadows, else 1.
        trust_rpc: Take the first RPC found for an image even if it seems to belong to another one.
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
        overwrite: Adjust again, whatever the run folder holds.
        progress: Receives the events of the work (:mod:`satgs.events`). ``None``: warnings become Python's warnings of the
            class :class:`SatgsWarning`, everything else is silent.

    Raises:
        InputError: The scene or an option is wrong, or the run folder was made from something else or is in use.
        FailedError: A file cannot be written, or no solution was found.
    """
    options = locals()
    check("adjust", options)
    return _adjusted(_satgs.adjust(scene, run, options, _warn if progress is None else progress))


def train(
    run: PathLike,
    *,
    recipe: PathLike | None = None,
    iterations: int | None = None,
    no_splats: bool | None = None,
    seed: int | None = None,
    checkpoint_every: int | None = None,
    resume: bool | None = None,
    snapshots: int | None = None,
    features: PathLike | None = None,
    lpips: PathLike | None = None,
    overwrite: bool | None = None,
    progress: Progress | None = None,
) -> Trained:
    """Trains Gaussian splats on an adjusted run: writes ``RUN/splats.ply``, ``RUN/cameras.json`` and ``RUN/train``.

    Training goes on from a checkpoint of the same input and options; when it is interrupted, it writes one. A training that
    is complete is kept.

    Args:
        run: The run folder of :func:`adjust`.
        recipe: Name of a recipe (``best``, ``baeogs``, ``eogs``, ``satgs``) or a TOML file. ``None``: ``best``.
        iterations: Number of iterations, to which the recipe's schedule is scaled. ``None``: the recipe's own.
        no_splats: Stop at the surface that matching finds: no splats are trained. For two or three images the heights are those
            of a run with splats; for more, training makes them better.
        seed: Seed of all random numbers; the same seed gives the same bytes. ``None``: 0.
        checkpoint_every: Number of iterations from one checkpoint to the next.
        resume: Fail unless there is a checkpoint to go on from.
        snapshots: Number of pictures of the progress to write to ``RUN/train/snapshots``. ``None``: 0.
        features: For ``satgs``, a network (ONNX) by whose features cars and the like are found.
        lpips: For ``satgs``, a safetensors file of ``scripts/fetch-weights``, for the perceptual loss.
        overwrite: Train again, whatever the run folder holds.
        progress: As for :func:`adjust`.

    Raises:
        InputError: The run is not adjusted, is in use or was trained from something else, or an option is wrong.
        FailedError: A file cannot be written.
    """
    options = locals()
    check("train", options)
    return _trained(_satgs.train(run, options, _warn if progress is None else progress))


def dsm(
    run: PathLike,
    *,
    resolution_m: float | None = None,
    like: PathLike | None = None,
    vertical: str | None = None,
    fill_m: float | None = None,
    no_fill: bool | None = None,
    hillshade: bool | None = None,
    points: PathLike | None = None,
    mesh: PathLike | None = None,
    overwrite: bool | None = None,
    progress: Progress | None = None,
) -> DsmSummary:
    """Renders the surface model of a trained run: writes ``RUN/dsm.tif``, ``RUN/ortho.tif`` and ``RUN/confidence.tif``.

    All are Cloud-Optimized GeoTIFFs on the UTM grid. ``dsm.tif`` holds heights in metres (float32, nodata NaN). A surface model
    that is complete is kept, and products that are missing are added.

    Args:
        run: The run folder of :func:`train`.
        resolution_m: Side of a cell, metres; the extent is the trained area. ``None``: 0.5.
        like: A raster whose grid and extent are taken instead.
        vertical: Vertical reference of the heights: ``ellipsoid``, ``EGM84``, ``EGM96``, ``EGM2008`` or the file of a geoid
            grid. ``None``: that of an existing ``RUN/dsm.tif``, else the ellipsoid.
        fill_m: Interpolate holes up to this width, metres. ``None``: holes stay nodata.
        no_fill: Leave cells that fewer than two views confirm as nodata. ``None``: they are filled in from the cells around
            them, and ``confidence.tif`` has fewer than two views there.
        hillshade: Also write the shaded relief, ``RUN/hillshade.tif``.
        points: Also write the cells as a coloured point cloud (``.laz``, ``.las``); a relative path counts from ``run``.
        mesh: Also write a textured mesh (``.glb``); a relative path counts from ``run``.
        overwrite: Render again, whatever the run folder holds.
        progress: As for :func:`adjust`.

    Raises:
        InputError: The run is not trained, is in use or holds another surface model, or an option is wrong.
        FailedError: A file cannot be written.
    """
    options = locals()
    check("dsm", options)
    return _dsm_summary(_satgs.dsm(run, options, _warn if progress is None else progress))


def compare(
    dsm: PathLike,
    truth: PathLike,
    *,
    classes: PathLike | None = None,
    mask: PathLike | None = None,
    truth_vertical: str | None = None,
    truth_epsg: int | None = None,
    confidence: PathLike | None = None,
    output: PathLike | None = None,
    overwrite: bool | None = None,
    progress: Progress | None = None,
) -> Evaluation:
    """Scores a surface model against a truth, after each of three registrations.

    Args:
        dsm: The surface model, of satgs or of any other program: a raster on a map grid in metres.
        truth: The truth: such a raster, DFC2019's ``X_DSM.tif`` with its ``.txt``, or points (``.las``, ``.laz``).
        classes: Class raster on the truth's grid, in which 9 is water. ``None``: ``X_CLS.tif`` beside ``X_DSM.tif``, or the
            classes of points.
        mask: Polygons, or a raster on the truth's grid that is not 0 inside: inside and outside are scored apart.
        truth_vertical: Vertical reference of the truth's heights: ``ellipsoid``, ``EGM84``, ``EGM96``, ``EGM2008`` or the file of
            a geoid grid. ``None``: as the file says.
        truth_epsg: EPSG code of a point cloud that does not state its own.
        confidence: Confidence of the surface model, as :func:`dsm` writes it; with it, cells that two views confirm and cells
            that are filled in are scored apart too. ``None``: ``confidence.tif`` beside the surface model, if it has the same
            cells.
        output: Folder for ``metrics.json``, the error map and figures. ``None``: nothing is written.
        overwrite: Replace files of an earlier evaluation.
        progress: As for :func:`adjust`.

    Raises:
        InputError: A file cannot be read, has no place on the map, or has no ground in common with the other; an output
            exists.
        FailedError: A file cannot be written.
    """
    options = locals()
    check("compare", options)
    return from_json(Evaluation, _satgs.compare(dsm, truth, output, options, _warn if progress is None else progress))


def run(
    scene: PathLike,
    run: PathLike,
    *,
    rpcs: str | None = None,
    suns: Mapping[str, tuple[float, float]] | None = None,
    aoi: tuple[float, float, float, float] | PathLike | None = None,
    bands: Sequence[int] | None = None,
    stretch_percent: float | None = None,
    gamma: float | None = None,
    trust_rpc: bool | None = None,
    model: Literal["shift", "shift-scale", "affine"] | None = None,
    fixed: bool | None = None,
    height_range: tuple[float, float] | None = None,
    dem: PathLike | None = None,
    dem_vertical: str | None = None,
    dem_sigma_m: float | None = None,
    gcps: PathLike | None = None,
    reference_views: Sequence[str] | None = None,
    recipe: PathLike | None = None,
    iterations: int | None = None,
    no_splats: bool | None = None,
    seed: int | None = None,
    checkpoint_every: int | None = None,
    resume: bool | None = None,
    snapshots: int | None = None,
    features: PathLike | None = None,
    lpips: PathLike | None = None,
    resolution_m: float | None = None,
    like: PathLike | None = None,
    vertical: str | None = None,
    fill_m: float | None = None,
    no_fill: bool | None = None,
    hillshade: bool | None = None,
    points: PathLike | None = None,
    mesh: PathLike | None = None,
    truth: PathLike | None = None,
    classes: PathLike | None = None,
    mask: PathLike | None = None,
    truth_vertical: str | None = None,
    truth_epsg: int | None = None,
    core_m: float | None = None,
    overlap_m: float | None = None,
    max_memory_mb: float | None = None,
    overwrite: bool | None = None,
    progress: Progress | None = None,
) -> RunResult:
    """Does everything: adjusts, trains, renders, scores if there is a truth, and writes ``RUN/report.html``.

    Stages that the run folder holds already, made from the same input and options, are kept: the same call goes on where it
    was interrupted. An area that is larger than one tile is cut into tiles, which are trained one after the other and blended.

    Args:
        scene: As for :func:`adjust`, as are all arguments up to ``reference_views``.
        run: The run folder.
        recipe: As for :func:`train`, as are all arguments up to ``lpips``.
        resolution_m: As for :func:`dsm`, as are all arguments up to ``mesh``.
        truth: A surface model or points to score the result against; the four arguments after it as for :func:`compare`.
        core_m: Largest side of an area that is trained as a whole, and of the core of a tile, metres.
        overlap_m: Width of the ground around a core that is trained as well, metres; seams are cut there.
        max_memory_mb: Memory that a tile may take, megabytes. ``None``: there is no limit.
        overwrite: Make everything again, whatever the run folder holds.
        progress: As for :func:`adjust`.

    Raises:
        InputError: The scene or an option is wrong, or the run folder was made from something else or is in use.
        PartialError: Some tiles failed; everything else is complete.
        FailedError: A file cannot be written, or no solution was found.
    """
    # Scores are with the confidence of the run's own surface model.
    options = locals() | {"confidence": None}
    check("run", options)
    results = dict(_satgs.run(scene, run, options, _warn if progress is None else progress))

    def of(stage: str, made: Callable[[tuple[str | None, bool]], T]) -> T | None:
        return made(results[stage]) if stage in results else None

    return RunResult(
        adjusted=_adjusted(results["ba"]),
        trained=of("train", _trained),
        dsm=of("dsm", _dsm_summary),
        mosaic=of("mosaic", _mosaicked),
        evaluation=of("dsm-eval", lambda figures: from_json(Evaluation, _recorded(figures))),
        report=of("report", lambda path: Path(_recorded(path))),
    )


def set_threads(threads: int) -> None:
    """Sets the number of threads that satgs works with; results do not depend on it.

    To be called at most once, before any other call. Without it the environment variable ``RAYON_NUM_THREADS`` counts, else
    there is a thread for each core.

    Raises:
        InputError: The number is 0.
        FailedError: satgs has begun to work.
    """
    _satgs.set_threads(threads)


def _adjusted(figures: tuple[str | None, bool]) -> Adjusted:
    return from_json(Adjusted, _recorded(figures), was_complete=figures[1])


def _trained(figures: tuple[str | None, bool]) -> Trained:
    return from_json(Trained, _recorded(figures), was_complete=figures[1])


def _dsm_summary(figures: tuple[str | None, bool]) -> DsmSummary:
    return from_json(DsmSummary, _recorded(figures), was_complete=figures[1])


def _mosaicked(figures: tuple[str | None, bool]) -> Mosaicked:
    return from_json(Mosaicked, _recorded(figures), was_complete=figures[1])


def _recorded(figures: tuple[str | None, bool]) -> str:
    if figures[0] is None:
        message = "the stage is complete, but `summary.json` with its figures is missing in the run folder"
        raise FailedError(message, "overwrite=True makes it anew")
    return figures[0]


def _warn(event: Event) -> None:
    """The callback of calls that have none."""
    if isinstance(event, events.Warning):
        # Seen from the line that called satgs.
        warnings.warn(event.text, SatgsWarning, stacklevel=3)
