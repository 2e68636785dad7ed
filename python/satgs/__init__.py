"""Surface models, orthophotos and Gaussian splats from satellite images with RPC cameras.

:func:`run` does everything; :func:`adjust`, :func:`train` and :func:`dsm` are its stages, which work on a run folder and
keep what is complete; :func:`compare` scores a surface model; :class:`Rpc` is the camera. The run folder is that of the
command line, so that commands and calls can be mixed.

Angles are degrees, lengths metres, heights metres above the WGS 84 ellipsoid unless a geoid is named. Results are the same
bytes for the same input, options and seed, whatever the number of threads.

Python's lock is released while satgs works. Ctrl-C during a call leaves a checkpoint where there can be one and then raises
``KeyboardInterrupt``; the same call goes on from it.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from satgs import events
    from satgs._calls import adjust, compare, dsm, run, set_threads, train
    from satgs._rpc import Rpc
    from satgs._satgs import __version__
    from satgs.errors import FailedError, InputError, PartialError, SatgsError, SatgsWarning
    from satgs.events import Event
    from satgs.results import Adjusted, DsmSummary, Evaluation, Mosaicked, RunResult, Trained

__all__ = [
    "Adjusted",
    "DsmSummary",
    "Evaluation",
    "Event",
    "FailedError",
    "InputError",
    "Mosaicked",
    "PartialError",
    "Rpc",
    "RunResult",
    "SatgsError",
    "SatgsWarning",
    "Trained",
    "__version__",
    "adjust",
    "compare",
    "dsm",
    "events",
    "run",
    "set_threads",
    "train",
]

_HOMES = {
    "satgs._calls": ("adjust", "compare", "dsm", "run", "set_threads", "train"),
    "satgs._rpc": ("Rpc",),
    "satgs._satgs": ("__version__",),
    "satgs.errors": ("FailedError", "InputError", "PartialError", "SatgsError", "SatgsWarning"),
    "satgs.events": ("Event",),
    "satgs.results": ("Adjusted", "DsmSummary", "Evaluation", "Mosaicked", "RunResult", "Trained"),
}
"""The module of each name. It is imported at first use, so that :mod:`satgs.dask` works without the extension module."""


def __getattr__(name: str) -> Any:
    if name in ("errors", "events", "results"):
        return import_module(f"satgs.{name}")
    for home, names in _HOMES.items():
        if name in names:
            return getattr(import_module(home), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
