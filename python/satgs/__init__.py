"""Surface models, orthophotos and Gaussian splats from satellite images with RPC cameras.

:func:`run` does everything; :func:`adjust`, :func:`train` and :func:`dsm` are its stages, which work on a run folder and
keep what is complete; :func:`compare` scores a surface model; :class:`Rpc` is the camera. The run folder is that of the
command line, so that commands and calls can be mixed.

Angles are degrees, lengths metres, heights metres above the WGS 84 ellipsoid unless a geoid is named. Results are the same
bytes for the same input, options and seed, whatever the number of threads.

Python's lock is released while satgs works. Ctrl-C during a call leaves a checkpoint where there can be one and then raises
``KeyboardInterrupt``; the same call goes on from it.
"""

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
