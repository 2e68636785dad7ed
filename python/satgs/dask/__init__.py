"""The tiles of a plan on a Dask cluster: the command ``satgs-dask`` and the call :func:`run_tiles`.

The work itself is done by the program ``satgs``, one process a job: ``satgs tile run``, ``satgs tile blend`` and
``satgs mosaic``. Dask starts these processes on the workers and reports their ends; images and results are files in the
run folder, which the client and all workers must see under the same path. Nothing but the names of tiles passes through
the scheduler.
"""

from .cli import main
from .driver import Result, Settings, run_tiles
from .plan import PlanError

__all__ = ["PlanError", "Result", "Settings", "main", "run_tiles"]
