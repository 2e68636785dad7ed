"""A program that uses every public name; `mypy --strict` checks it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import satgs


def show(event: satgs.Event) -> None:
    if isinstance(event, satgs.events.Started):
        print(event.stage, event.total)
    elif isinstance(event, satgs.events.Advanced):
        print(event.done, event.status)
    elif isinstance(event, satgs.events.Warning):
        print(event.text)


def columns(path: Path) -> NDArray[np.float64]:
    rpc = satgs.Rpc.read(path)
    lon, lat = rpc.localize(np.arange(10.0), 0.0, rpc.height_range[0])
    col, _ = rpc.project(lon, lat, [rpc.height_range[0]] * 10)
    return col


def surface(scene: Path, run: Path) -> float:
    try:
        adjusted: satgs.Adjusted = satgs.adjust(scene, str(run), aoi=(8.0, 47.0, 8.1, 47.1), progress=show)
        print([view.shift_px[0] for view in adjusted.views], adjusted.seconds)
        trained: satgs.Trained = satgs.train(run, iterations=500)
        made: satgs.DsmSummary = satgs.dsm(run, resolution_m=1.0)
        print(trained.splats, made.grid.epsg)
        evaluation: satgs.Evaluation = satgs.compare(run / "dsm.tif", "lidar.laz", truth_epsg=32617)
        everything: satgs.RunResult = satgs.run(scene, run, suns={"a": (150.0, 50.0)}, truth="lidar.laz")
        mean_px = 0.0 if everything.adjusted is None else everything.adjusted.mean_px
        return evaluation.after("xyz").mae_m + mean_px
    except satgs.InputError as error:
        print(error.message, error.hint or "")
        raise


def pictures(scene: Path, run: Path) -> NDArray[np.float32]:
    options: satgs.options.RunOptions = {"iterations": 5, "test_views": 4, "progress": True}
    satgs.run(scene, run, **options)
    opened = satgs.Run(run)
    heights: NDArray[np.float32] = opened.dsm.values
    splats = opened.splats.crop((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)).transform(2.0)
    camera = satgs.PinholeCamera.looking_at((0.0, 0.0, 5.0), (1.0, 0.0, 0.0), size=(64, 48), focal_px=60.0)
    read = satgs.Scene.read(scene, downsampling=2)
    view = read.views[0]
    if isinstance(view.camera, satgs.Rpc):
        print(view.camera.height_range, view.sun, heights.shape)
    info = satgs.info(scene)
    print(info.ground.epsg if isinstance(info, satgs.results.SatelliteInfo) else info)
    return splats.render(camera).colors
