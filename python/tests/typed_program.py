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
        return evaluation.after("xyz").mae_m + everything.adjusted.mean_px
    except satgs.InputError as error:
        print(error.message, error.hint or "")
        raise
