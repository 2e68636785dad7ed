"""The calls: one for each command, keyword arguments in, an object of `satgs.results` out.

The keyword arguments are those of `satgs.options`. An argument that is ``None`` takes the default of the command line.
"""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from satgs import _satgs, options as o
from satgs import results as r
from satgs._command_words import Figures, calls, run_command
from satgs.errors import FailedError
from satgs.results import from_json

if TYPE_CHECKING:
    from typing_extensions import Unpack

PathLike = str | os.PathLike[str]
T = TypeVar("T")


@calls("info", o.InfoOptions)
def info(
    scene: PathLike, **options: Unpack[o.InfoOptions]
) -> r.SatelliteInfo | r.PhotographsInfo | r.SplatFileInfo | r.TilesetInfo:
    """Shows what a scene contains: views, cameras, suns, dates, convergence angles, common ground; for photographs lenses, points,
    reprojection errors and whether cameras and images agree; for a splat file or a ``tileset.json`` what it holds.

    Args:
        scene: As for :func:`adjust`, or photographs with poses: a COLMAP project, a ``transforms.json``, RGB-D frames, a scene
            of LEVIR-NVS or ScanNet++; or a file of splats, or a ``tileset.json``.
        **options: See :class:`satgs.options.InfoOptions`.

    Raises:
        InputError: The scene or an option is wrong, or the views have no ground in common.
    """
    (figures,) = run_command("info", {"scene": scene, **options})
    keys = json.loads(_recorded(figures))
    if "layout" in keys:
        return _result(r.PhotographsInfo, figures)
    if "axes" in keys:
        return _result(r.SplatFileInfo, figures)
    if "tiles" in keys:
        return _result(r.TilesetInfo, figures)
    return _result(r.SatelliteInfo, figures)


@calls("ba", o.AdjustOptions)
def adjust(scene: PathLike, run: PathLike, **options: Unpack[o.AdjustOptions]) -> r.Adjusted:
    """Corrects the RPC cameras of a scene by bundle adjustment: writes ``RUN/scene.json`` and ``RUN/ba``.

    ``RUN/ba`` gets the corrected RPCs, tie points, sparse points and a report. An adjustment that the run folder holds
    already, of the same input and options, is kept.

    Args:
        scene: Folder of images with RPCs, a folder with ``images/`` and folders of RPC files, or a list of views (TOML, STAC).
        run: The run folder.
        **options: See :class:`satgs.options.AdjustOptions`.

    Raises:
        InputError: The scene or an option is wrong, or the run folder was made from something else or is in use.
        FailedError: A file cannot be written, or no solution was found.
    """
    return _only(r.Adjusted, "adjust", {"scene": scene, "run": run, **options})


@calls("train", o.TrainOptions)
def train(run: PathLike, **options: Unpack[o.TrainOptions]) -> r.Trained:
    """Trains Gaussian splats on an adjusted run: writes ``RUN/splats.ply``, ``RUN/cameras.json`` and ``RUN/train``.

    An interrupted training writes a checkpoint, and the same call continues from it. A training that is complete is kept.

    Args:
        run: The run folder of :func:`adjust`, or of :func:`run` or :func:`predict` of photographs.
        **options: See :class:`satgs.options.TrainOptions`.

    Raises:
        InputError: The run is not adjusted, is in use or was trained from something else, or an option is wrong.
        FailedError: A file cannot be written.
    """
    return _only(r.Trained, "train", {"run": run, **options})


@calls("dsm", o.DsmOptions)
def dsm(run: PathLike, **options: Unpack[o.DsmOptions]) -> r.DsmSummary:
    """Renders the surface model of a trained run: writes ``RUN/dsm.tif``, ``RUN/ortho.tif`` and ``RUN/confidence.tif``.

    All are Cloud-Optimized GeoTIFFs on the UTM grid. ``dsm.tif`` holds heights in metres (float32, nodata NaN). A surface model
    that is complete is kept, and products that are missing are added.

    Args:
        run: The run folder of :func:`train`.
        **options: See :class:`satgs.options.DsmOptions`.

    Raises:
        InputError: The run is not trained, is in use or holds another surface model, or an option is wrong.
        FailedError: A file cannot be written.
    """
    return _only(r.DsmSummary, "dsm", {"run": run, **options})


@calls("dsm-eval", o.CompareOptions)
def compare(dsm: PathLike, truth: PathLike, **options: Unpack[o.CompareOptions]) -> r.Evaluation:
    """Scores a surface model against a truth, after each of three registrations.

    Args:
        dsm: The surface model, of satgs or of any other program: a raster on a map grid in metres.
        truth: The truth: such a raster, DFC2019's ``X_DSM.tif`` with its ``.txt``, or points (``.las``, ``.laz``).
        **options: See :class:`satgs.options.CompareOptions`.

    Raises:
        InputError: A file cannot be read, has no place on the map, or has no ground in common with the other; an output
            exists.
        FailedError: A file cannot be written.
    """
    return _only(r.Evaluation, "compare", {"dsm": dsm, "truth": truth, **options})


@calls("changes", o.ChangesOptions)
def changes(earlier: PathLike, later: PathLike, output: PathLike, **options: Unpack[o.ChangesOptions]) -> r.Changes:
    """Finds what changed between two runs or surface models: regions that rose or fell, with their volumes.

    ``output`` gets ``difference.tif`` (difference and its standard deviation), ``difference.png``, ``changes.gpkg`` and
    ``changes.json``.

    Args:
        earlier: The earlier run folder, or the raster of a surface model.
        later: The later one.
        output: Folder for the results.
        **options: See :class:`satgs.options.ChangesOptions`.

    Raises:
        InputError: A file cannot be read or has no ground in common with the other; an output exists.
        FailedError: A file cannot be written.
    """
    return _only(r.Changes, "changes", {"earlier": earlier, "later": later, "output": output, **options})


@calls("run", o.RunOptions)
def run(scene: PathLike, run: PathLike, **options: Unpack[o.RunOptions]) -> r.RunResult:
    """Runs all stages: adjusts, trains, renders, scores if there is a truth, and writes ``RUN/report.html``.

    Stages in the run folder that were made from the same input and options are kept: the same call continues an interrupted run.
    An area with a side of more than 1.5 times ``core_m`` is cut into tiles, which are trained one after the other and blended.
    Photographs are not adjusted; held-back views are scored, and with ``georef`` a surface model is rendered.

    Args:
        scene: As for :func:`info`.
        run: The run folder.
        **options: See :class:`satgs.options.RunOptions`.

    Raises:
        InputError: The scene or an option is wrong, or the run folder was made from something else or is in use.
        PartialError: Some tiles failed; everything else is complete.
        FailedError: A file cannot be written, or no solution was found.
    """
    stages = {figures[0]: figures for figures in run_command("run", {"scene": scene, "run": run, **options})}

    def of(stage: str, result: type[T]) -> T | None:
        return _result(result, stages[stage]) if stage in stages else None

    return r.RunResult(
        adjusted=of("ba", r.Adjusted),
        trained=of("train", r.Trained),
        scored=of("nvs-eval", r.NvsScores),
        dsm=of("dsm", r.DsmSummary),
        plan=of("plan", r.Plan),
        mosaic=of("mosaic", r.Mosaicked),
        evaluation=of("dsm-eval", r.Evaluation),
        report=_page(stages["report"]) if "report" in stages else None,
    )


@calls("align", o.AlignOptions)
def align(run: PathLike, to: PathLike, **options: Unpack[o.AlignOptions]) -> r.Aligned:
    """Aligns a run to a reference: one shift east, north and up of all that it holds, which ``RUN/align.json`` records.

    Args:
        run: Run folder of :func:`adjust`, or of later stages.
        to: A surface model (a raster on a map in metres), lidar points (``.las``, ``.laz``), or ground control points
            (``.csv``).
        **options: See :class:`satgs.options.AlignOptions`.

    Raises:
        InputError: The run or the reference is wrong, or they have no ground in common.
        FailedError: A file cannot be written; nothing is moved then.
    """
    return _only(r.Aligned, "align", {"run": run, "to": to, **options})


@calls("render", o.RenderOptions)
def render(run: PathLike, output: PathLike, **options: Unpack[o.RenderOptions]) -> r.Rendered:
    """Renders images of a trained run from any direction, under any sun; of photographs from their own cameras.

    Args:
        run: Run folder of :func:`train`.
        output: The image: ``.png`` of colours, or ``.tif`` of colours and heights as float32.
        **options: See :class:`satgs.options.RenderOptions`. One of ``like``, ``view`` and ``visibility`` is needed.

    Raises:
        InputError: The run is not trained, or an option is wrong.
        FailedError: A file cannot be written.
    """
    return _only(r.Rendered, "render", {"run": run, "output": output, **options})


@calls("nvs-eval", o.NvsEvalOptions)
def nvs_eval(run: PathLike, **options: Unpack[o.NvsEvalOptions]) -> r.NvsScores:
    """Scores rendered images of a trained run against images that were held back from training.

    Args:
        run: Run folder of :func:`train`.
        **options: See :class:`satgs.options.NvsEvalOptions`.

    Raises:
        InputError: The run is not trained, or there is no view to score.
    """
    return _only(r.NvsScores, "nvs_eval", {"run": run, **options})


@calls("mesh", o.MeshOptions)
def mesh(source: PathLike, output: PathLike, **options: Unpack[o.MeshOptions]) -> r.MeshSummary:
    """Makes a mesh with walls and colours of a run, or of a scene with depth maps.

    Args:
        source: Run folder of :func:`train`, or a scene with depth maps.
        output: The mesh (``.ply``, ``.obj``, ``.glb``).
        **options: See :class:`satgs.options.MeshOptions`.

    Raises:
        InputError: The input has no depths, or an option is wrong.
        FailedError: A file cannot be written.
    """
    return _only(r.MeshSummary, "mesh", {"source": source, "output": output, **options})


@calls("mesh-eval", o.MeshEvalOptions)
def mesh_eval(mesh: PathLike, reference: PathLike, **options: Unpack[o.MeshEvalOptions]) -> r.MeshEvaluation:
    """Scores a mesh against a reference: accuracy, completeness, precision, recall, F1, chamfer distance.

    Args:
        mesh: The mesh (``.ply``, ``.obj``).
        reference: The reference (``.ply``, ``.obj``).
        **options: See :class:`satgs.options.MeshEvalOptions`.

    Raises:
        InputError: A file cannot be read, or an option is wrong.
        FailedError: A file cannot be written.
    """
    return _only(r.MeshEvaluation, "mesh_eval", {"mesh": mesh, "reference": reference, **options})


@calls("prior", o.PriorOptions)
def prior(scene: PathLike, output: PathLike, **options: Unpack[o.PriorOptions]) -> r.MadePriors:
    """Makes depth or normal maps of the images of a scene of photographs, with a network, a command or matching.

    Args:
        scene: The scene.
        output: Folder of the maps, which training takes as ``depth_prior`` or ``normal_prior``.
        **options: See :class:`satgs.options.PriorOptions`.

    Raises:
        InputError: The scene or an option is wrong, or the folder holds maps of other makers or images.
        FailedError: A file cannot be written, or the command failed.
    """
    return _only(r.MadePriors, "prior", {"scene": scene, "output": output, **options})


@calls("predict", o.PredictOptions)
def predict(run: PathLike, output: PathLike, **options: Unpack[o.PredictOptions]) -> r.Predicted:
    """Predicts splats from points in one pass, in seconds instead of minutes of training (Point2GS).

    Args:
        run: Run folder with adjusted cameras, a scene of photographs, or its run.
        output: The run folder to write; it serves all calls that take trained runs.
        **options: See :class:`satgs.options.PredictOptions`.

    Raises:
        InputError: The run, the points or the model cannot be used, or the output holds something else.
        FailedError: A file cannot be written.
    """
    return _only(r.Predicted, "predict", {"run": run, "output": output, **options})


@calls("learn", o.LearnOptions)
def learn(out: PathLike, **options: Unpack[o.LearnOptions]) -> r.Learned | r.WrittenModel:
    """Trains the network by which :func:`predict` makes splats, on simulated towns or on photographs with depth maps.

    After an interruption the same call continues and gives the same model.

    Args:
        out: The model to write (``.safetensors``); with ``start`` alone also ``.onnx``.
        **options: See :class:`satgs.options.LearnOptions`.

    Raises:
        InputError: An option is wrong.
        FailedError: A file cannot be written.
    """
    scenes = options.get("scenes")
    is_written_only = options.get("start") is not None and (scenes is None or len(scenes) == 0)
    result: type[r.Learned | r.WrittenModel] = r.WrittenModel if is_written_only else r.Learned
    return _only(result, "learn", {"out": out, **options})


@calls("export", o.ExportOptions)
def export(
    run: PathLike, **options: Unpack[o.ExportOptions]
) -> r.ExportedViews | r.ExportedSplats | r.ExportedTileset:
    """Exports a run for other programs: a COLMAP project, splats in the formats of viewers, or 3D Tiles.

    Args:
        run: Run folder of :func:`adjust` or :func:`train`.
        **options: See :class:`satgs.options.ExportOptions`.

    Raises:
        InputError: The run holds nothing to export, the output exists, or an option is wrong.
        FailedError: A file cannot be written.
    """
    result: type[r.ExportedViews | r.ExportedSplats | r.ExportedTileset] = r.ExportedSplats
    if options.get("colmap"):
        result = r.ExportedViews
    elif options.get("tiles3d"):
        result = r.ExportedTileset
    return _only(result, "export", {"run": run, **options})


@calls("simulate", o.SimulateOptions)
def simulate(out: PathLike, **options: Unpack[o.SimulateOptions]) -> r.Simulated:
    """Simulates a scene with a known answer: satellite images of a town, a mountain or a surface, photographs of a room or
    from the air.

    Args:
        out: Folder for the scene.
        **options: See :class:`satgs.options.SimulateOptions`.

    Raises:
        InputError: An option is wrong, or the folder holds an earlier simulation.
        FailedError: A file cannot be written.
    """
    return _only(r.Simulated, "simulate", {"out": out, **options})


@calls("plan", o.PlanOptions)
def plan(scene: PathLike, run: PathLike, **options: Unpack[o.PlanOptions]) -> r.Planned:
    """Plans the tiles of a large scene: writes ``RUN/tiles.json`` with the predicted time and memory of each.

    Args:
        scene: As for :func:`adjust`.
        run: The run folder. It is adjusted first, unless it is already.
        **options: See :class:`satgs.options.PlanOptions`.

    Raises:
        InputError: The scene or an option is wrong, or the run folder was made from something else or is in use.
        FailedError: A file cannot be written, or no solution was found.
    """
    adjusted, planned = run_command("plan", {"scene": scene, "run": run, **options})
    return r.Planned(_result(r.Adjusted, adjusted), _result(r.Plan, planned))


@calls("tile run", o.TileRunOptions)
def tile_run(run: PathLike, id: str, **options: Unpack[o.TileRunOptions]) -> r.TileDone:
    """Trains and renders one tile of a plan: writes ``RUN/tiles/ID``.

    Args:
        run: Run folder of :func:`plan`.
        id: ID of the tile.
        **options: See :class:`satgs.options.TileRunOptions`.

    Raises:
        InputError: There is no such plan or tile, or what it was made from has changed.
        FailedError: A file cannot be written, or the machine has too little memory or disk.
    """
    return _only(r.TileDone, "tile_run", {"run": run, "id": id, **options})


@calls("tile blend", o.TileBlendOptions)
def tile_blend(run: PathLike, id: str, **options: Unpack[o.TileBlendOptions]) -> r.Blended:
    """Blends one tile with its neighbours, which must be done: writes ``RUN/mosaic/ID_*.tif``.

    Args:
        run: Run folder of :func:`plan`.
        id: ID of the tile.
        **options: See :class:`satgs.options.TileBlendOptions`.

    Raises:
        InputError: There is no such plan or tile, or a neighbour is not done.
        FailedError: A file cannot be written.
    """
    return _only(r.Blended, "tile_blend", {"run": run, "id": id, **options})


@calls("tile status", o.Reporting)
def tile_status(run: PathLike, **options: Unpack[o.Reporting]) -> r.Status:
    """Says which tiles are done, running, planned or failed.

    Args:
        run: Run folder of :func:`plan`.
        **options: See :class:`satgs.options.Reporting`.

    Raises:
        InputError: There is no such plan.
    """
    return _only(r.Status, "tile_status", {"run": run, **options})


@calls("mosaic", o.Reporting)
def mosaic(run: PathLike, **options: Unpack[o.Reporting]) -> r.Mosaicked:
    """Joins the tiles of a plan: writes ``RUN/dsm.tif``, ``ortho.tif``, ``confidence.tif``, ``seams.gpkg`` and ``report.html``.

    Tiles that are not done are nodata; the result and a warning list them.

    Args:
        run: Run folder of :func:`plan`.
        **options: See :class:`satgs.options.Reporting`.

    Raises:
        InputError: There is no such plan, or no tile is done.
        FailedError: A file cannot be written.
    """
    return _only(r.Mosaicked, "mosaic", {"run": run, **options})


@calls("report", o.Reporting)
def report(run: PathLike, **options: Unpack[o.Reporting]) -> Path:
    """Writes ``RUN/report.html``: all that the run holds on one page. Returns its path.

    Args:
        run: The run folder.
        **options: See :class:`satgs.options.Reporting`.

    Raises:
        InputError: The folder is no run.
        FailedError: A file cannot be written.
    """
    (figures,) = run_command("report", {"run": run, **options})
    return _page(figures)


@calls("view", o.ViewOptions)
def view(run: PathLike, html: PathLike, **options: Unpack[o.ViewOptions]) -> r.WrittenPage:
    """Writes a page that shows a run in the browser: splats, mesh, surface model, sparse points and cameras.

    Args:
        run: Run folder of :func:`train`, or of a tile.
        html: The page (``.html``), one file that opens without satgs and without a network.
        **options: See :class:`satgs.options.ViewOptions`.

    Raises:
        InputError: The run holds nothing to show, or the file exists.
        FailedError: A file cannot be written.
    """
    return _only(r.WrittenPage, "view", {"run": run, "html": html, **options})


@calls("rpc convert", o.RpcConvertOptions)
def rpc_convert(file: PathLike, out: PathLike, **options: Unpack[o.RpcConvertOptions]) -> r.ConvertedRpc:
    """Writes a camera in another format, with 17 significant digits.

    Args:
        file: RPC file, or image with its RPC inside or beside it.
        out: The file to write; its ending sets the format: ``.txt``, ``.rpb``, ``.json``, or ``.tif`` with ``image``.
        **options: See :class:`satgs.options.RpcConvertOptions`.

    Raises:
        InputError: The camera cannot be read, or the output exists.
        FailedError: The output cannot be written.
    """
    return _only(r.ConvertedRpc, "rpc_convert", {"file": file, "out": out, **options})


@calls("rpc compare", o.RpcOptions)
def rpc_compare(first: PathLike, second: PathLike, **options: Unpack[o.RpcOptions]) -> r.RpcDifference:
    """Compares two cameras over the volume of the first.

    Args:
        first: RPC file or image, whose volume is used.
        second: RPC file or image.
        **options: See :class:`satgs.options.RpcOptions`.

    Raises:
        InputError: A camera cannot be read, or they see no common ground.
    """
    return _only(r.RpcDifference, "rpc_compare", {"first": first, "second": second, **options})


@calls("rpc fit", o.RpcFitOptions)
def rpc_fit(file: PathLike, **options: Unpack[o.RpcFitOptions]) -> r.RpcFit:
    """Fits affine and quadratic cameras to an RPC over a box, and says how far they are from it.

    Args:
        file: RPC file or image.
        **options: See :class:`satgs.options.RpcFitOptions`.

    Raises:
        InputError: The camera cannot be read, or sees no ground in the box.
    """
    return _only(r.RpcFit, "rpc_fit", {"file": file, **options})


def set_threads(threads: int) -> None:
    """Sets the number of threads that satgs works with; results do not depend on it.

    To be called at most once, before any other call. Without it the environment variable ``RAYON_NUM_THREADS`` counts, else
    there is a thread for each core.

    Raises:
        InputError: The number is below 1.
        FailedError: satgs has begun to work.
    """
    _satgs.set_threads(threads)


def _only(result: type[T], call: str, arguments: Mapping[str, object]) -> T:
    """The result of a command of one stage."""
    (figures,) = run_command(call, arguments)
    return _result(result, figures)


def _result(result: type[T], figures: Figures) -> T:
    has_flag = any(f.name == "was_complete" for f in dataclasses.fields(result))  # type: ignore[arg-type]
    more = {"was_complete": figures[2]} if has_flag else {}
    return from_json(result, _recorded(figures), **more)


def _page(figures: Figures) -> Path:
    return Path(json.loads(_recorded(figures))["page"])


def _recorded(figures: Figures) -> str:
    if figures[1] is None:
        message = "the stage is complete, but `summary.json` with its figures is missing in the run folder"
        raise FailedError(message, "overwrite=True makes it again")
    return figures[1]
