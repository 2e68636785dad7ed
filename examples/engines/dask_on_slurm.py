"""Makes the tiles of a plan with Dask workers that run as SLURM jobs.

    python dask_on_slurm.py RUN WORKERS [PARTITION]

It needs `pip install './python[dask]' dask-jobqueue`, and runs on a node that may submit jobs until all tiles are done.
Other batch systems have classes of their own in dask-jobqueue: PBSCluster, LSFCluster, SGECluster, OARCluster,
HTCondorCluster.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import dask
from dask_jobqueue import SLURMCluster
from distributed import Client

from satgs.dask import Settings, run_tiles
from satgs.dask.plan import read_plan

CORES = 2


def options(run: Path, partition: str | None = None) -> dict[str, Any]:
    """What a worker is: one tile at a time, with a fifth more memory than the largest tile is predicted to need."""
    memory_mb = round(1.2 * max(tile.memory_mb for tile in read_plan(run).values()))
    return {
        "queue": partition,
        "cores": CORES,
        "processes": 1,
        "memory": f"{memory_mb}MB",
        "walltime": "12:00:00",
        # One job of Dask at a time, whatever the number of cores, which are for the threads of satgs.
        "worker_extra_args": ["--nthreads", "1", "--resources", f"tile=1,MEM={memory_mb}"],
        "job_extra_directives": [f"--output={run}/slurm-%j.log"],
    }


def main(arguments: list[str]) -> int:
    """Starts the workers, makes the tiles, and returns the exit code of satgs-dask."""
    run = Path(arguments[0]).absolute()
    workers = int(arguments[1])
    partition = arguments[2] if len(arguments) > 2 else None
    # Jobs that reach their time limit are no reason to give a tile up: it continues from its checkpoint.
    dask.config.set({"distributed.scheduler.allowed-failures": 20})
    with SLURMCluster(**options(run, partition)) as cluster, Client(cluster) as client:
        cluster.scale(jobs=workers)
        result = run_tiles(client, run, Settings(threads=CORES), sys.stderr)
    for tile in result.tiles.values():
        print(tile.id, tile.state, tile.reason)
    return result.exit_code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
