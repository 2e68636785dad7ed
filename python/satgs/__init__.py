"""Surface models, orthophotos and Gaussian splats from satellite images with RPC cameras, and from photographs.

:func:`run` does everything. There is a call for each command of satgs: :func:`info`, :func:`adjust`, :func:`train`, :func:`dsm`,
:func:`compare`, :func:`render` and so on, with the options of the command as keywords (:mod:`satgs.options`) and its figures as
the result (:mod:`satgs.results`). The run folder is that of the command line, so that commands and calls can be mixed.

:class:`Run` opens a run folder: surface model, orthophoto, splats, cameras and points as arrays. :class:`Scene` opens what a
user hands in. :class:`Splats`, :class:`Rpc` and :class:`PinholeCamera` work on arrays of NumPy.

Angles are degrees, lengths metres, heights metres above the WGS 84 ellipsoid unless a geoid is named. Results are the same
bytes for the same input, options and seed, whatever the number of threads.

Python's lock is released while satgs works. Ctrl-C during a call leaves a checkpoint where there can be one and then raises
``KeyboardInterrupt``; the same call continues from it.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from satgs import events, options, results
    from satgs._calls import (
        adjust,
        align,
        changes,
        compare,
        dsm,
        export,
        info,
        learn,
        mesh,
        mesh_eval,
        mosaic,
        nvs_eval,
        plan,
        predict,
        prior,
        render,
        report,
        rpc_compare,
        rpc_convert,
        rpc_fit,
        run,
        set_threads,
        simulate,
        tile_blend,
        tile_run,
        tile_status,
        train,
        view,
    )
    from satgs._mesh import Mesh, fuse_depths
    from satgs._pinhole import PinholeCamera
    from satgs._raster import Points, Raster
    from satgs._rpc import Rpc
    from satgs._run import Run
    from satgs._satgs import __version__
    from satgs._scene import Scene, View
    from satgs._site import Site
    from satgs._splats import Picture, Splats
    from satgs.errors import FailedError, InputError, PartialError, SatgsError, SatgsWarning
    from satgs.events import Event
    from satgs.results import Adjusted, DsmSummary, Evaluation, Mosaicked, RunResult, Trained

_HOMES = {
    "satgs._calls": (
        "adjust",
        "align",
        "changes",
        "compare",
        "dsm",
        "export",
        "info",
        "learn",
        "mesh",
        "mesh_eval",
        "mosaic",
        "nvs_eval",
        "plan",
        "predict",
        "prior",
        "render",
        "report",
        "rpc_compare",
        "rpc_convert",
        "rpc_fit",
        "run",
        "set_threads",
        "simulate",
        "tile_blend",
        "tile_run",
        "tile_status",
        "train",
        "view",
    ),
    "satgs._mesh": ("Mesh", "fuse_depths"),
    "satgs._pinhole": ("PinholeCamera",),
    "satgs._raster": ("Points", "Raster"),
    "satgs._rpc": ("Rpc",),
    "satgs._run": ("Run",),
    "satgs._satgs": ("__version__",),
    "satgs._scene": ("Scene", "View"),
    "satgs._site": ("Site",),
    "satgs._splats": ("Picture", "Splats"),
    "satgs.errors": ("FailedError", "InputError", "PartialError", "SatgsError", "SatgsWarning"),
    "satgs.events": ("Event",),
    "satgs.results": ("Adjusted", "DsmSummary", "Evaluation", "Mosaicked", "RunResult", "Trained"),
}
"""The module of each name. It is imported at first use, so that :mod:`satgs.dask` works without the extension module."""

_MODULES = ("errors", "events", "options", "results")

__all__ = [
    "Adjusted",
    "DsmSummary",
    "Evaluation",
    "Event",
    "FailedError",
    "InputError",
    "Mesh",
    "Mosaicked",
    "PartialError",
    "Picture",
    "PinholeCamera",
    "Points",
    "Raster",
    "Rpc",
    "Run",
    "RunResult",
    "SatgsError",
    "SatgsWarning",
    "Scene",
    "Site",
    "Splats",
    "Trained",
    "View",
    "__version__",
    "adjust",
    "align",
    "changes",
    "compare",
    "dsm",
    "events",
    "export",
    "fuse_depths",
    "info",
    "learn",
    "mesh",
    "mesh_eval",
    "mosaic",
    "nvs_eval",
    "options",
    "plan",
    "predict",
    "prior",
    "render",
    "report",
    "results",
    "rpc_compare",
    "rpc_convert",
    "rpc_fit",
    "run",
    "set_threads",
    "simulate",
    "tile_blend",
    "tile_run",
    "tile_status",
    "train",
    "view",
]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(f"satgs.{name}")
    for home, names in _HOMES.items():
        if name in names:
            return getattr(import_module(home), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
