"""The command ``satgs-dask``."""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import dask
from distributed import Client, LocalCluster
from distributed.system import MEMORY_LIMIT

from .driver import Result, Settings, run_tiles
from .plan import PlanError, read_plan

ALLOWED_FAILURES = 5
"""Workers that may die under a tile before it is given up."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit code.

    0 done, 1 nothing was made or the scheduler was lost, 2 wrong usage, 3 some tiles failed, 130 interrupted.
    """
    parser = _parser()
    args = parser.parse_args(arguments)
    if args.run is None:
        parser.error(
            "RUN is missing" + ("; it stands before --only, which takes all words after it" if args.only else "")
        )
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        plan = read_plan(args.run)
        if args.scheduler is None and shutil.which(args.satgs) is None:
            raise PlanError(f"there is no program `{args.satgs}`\nhint: --satgs PATH names it")
        jobs = args.local or _jobs_that_fit(max(tile.memory_mb for tile in plan.values()))
        threads = args.threads
        if threads is None and args.scheduler is None:
            threads = max(1, _cores() // jobs)
        settings = Settings(args.satgs, threads, args.retries, tuple(args.only))
        with _client(args.scheduler, jobs) as client:
            result = run_tiles(client, args.run, settings, sys.stderr)
    except PlanError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"error: {error}\nhint: tiles that are done are kept; call the same command again", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("interrupted; tiles that are done are kept, the same command continues", file=sys.stderr)
        return 130
    _print(args.run, result)
    return result.exit_code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="satgs-dask",
        usage="%(prog)s RUN [--local N | --scheduler ADDRESS] [--retries N] [--threads N] [--satgs PATH] "
        "[--only ID ...]",
        description="Makes the tiles of a plan on a Dask cluster, blends them and makes the mosaic. Tiles that are "
        "done are left as they are, so the same command continues after an interruption.",
        epilog="Exit codes: 0 done, 1 nothing was made, 2 wrong usage, 3 some tiles failed (they are empty in the "
        "mosaic), 130 interrupted. Workers of a cluster need this package, the program satgs, the same path to RUN, "
        "and the resources tile and MEM: `dask worker SCHEDULER --nthreads 1 --resources tile=1,MEM=4000`, with the "
        "memory in megabytes.",
    )
    # Optional for argparse only, so that RUN after --only gets an error of its own.
    parser.add_argument(
        "run", metavar="RUN", type=Path, nargs="?", help="run folder with tiles.json, which `satgs plan` makes"
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--local",
        metavar="N",
        type=_number(1),
        help="work on this machine, N tiles at once [default: as many as memory and pairs of cores allow]",
    )
    where.add_argument(
        "--scheduler", metavar="ADDRESS", help="address of a Dask scheduler, such as tcp://10.0.0.1:8786"
    )
    parser.add_argument("--retries", metavar="N", type=_number(0), default=2, help="tries after a failure [default: 2]")
    parser.add_argument(
        "--only",
        metavar="ID",
        nargs="+",
        action="extend",
        default=[],
        help="make only these tiles: `satgs-dask RUN --only x000_y000 x001_y000`",
    )
    parser.add_argument(
        "--threads",
        metavar="N",
        type=_number(1),
        help="threads of each tile [default: cores divided by N of --local; on a cluster all cores of the machine]",
    )
    parser.add_argument(
        "--satgs", metavar="PATH", default="satgs", help="the program satgs [default: satgs on the PATH]"
    )
    return parser


def _number(least: int) -> Callable[[str], int]:
    def read(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"`{text}` is not a whole number of {least} or more")
        return int(text)

    return read


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _jobs_that_fit(memory_mb: float) -> int:
    return max(1, min(_cores() // 2, int(MEMORY_LIMIT / 1e6 / memory_mb)))


@contextmanager
def _client(scheduler: str | None, jobs: int) -> Iterator[Any]:
    """A client of a running cluster, or of one on this machine that ends with the client."""
    # Dask's constructors have no types.
    client_of: Any = Client
    cluster_of: Any = LocalCluster
    cluster: Any = scheduler
    with ExitStack() as stack:
        if scheduler is None:
            # Workers inherit that Ctrl-C is ignored: the client ends their work in order.
            handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
            try:
                # Work is done by child processes, whose memory Dask does not see: it is to set no limit.
                with dask.config.set({"distributed.scheduler.allowed-failures": ALLOWED_FAILURES}):
                    resources = {"tile": 1, "MEM": MEMORY_LIMIT / 1e6 / jobs}
                    options = {"threads_per_worker": 1, "memory_limit": 0, "dashboard_address": ":0"}
                    cluster = stack.enter_context(cluster_of(n_workers=jobs, resources=resources, **options))
            finally:
                signal.signal(signal.SIGINT, handler)
        yield stack.enter_context(client_of(cluster, set_as_default=False))


def _print(run: Path, result: Result) -> None:
    """Prints a table of the tiles, and what the failed ones said."""
    tiles = [result.tiles[name] for name in result.selected]
    width = max(len(tile.id) for tile in tiles)
    print(f"{'tile':<{width}}  state    seconds  reason")
    for tile in tiles:
        seconds = f"{tile.seconds:7.1f}" if tile.attempts else "      -"
        print(f"{tile.id:<{width}}  {tile.state:<7}  {seconds}  {tile.reason}".rstrip())
    if any(tile.state == "failed" for tile in tiles):
        print(f"\nWhat the failed tiles said is in {run / 'tiles' / 'ID' / 'error.log'}.")
    if result.mosaic == "waiting":
        missing = [tile.id for tile in result.tiles.values() if tile.state == "waiting"]
        if missing:
            print(f"\nThe mosaic is made when all tiles are done; {len(missing)} are missing, such as {missing[0]}.")
    elif result.mosaic != "done":
        print(f"\nThe mosaic was not made: {result.mosaic}")
    else:
        print(f"\nmosaic: {run / 'dsm.tif'}, {run / 'ortho.tif'}, {run / 'confidence.tif'}")
        if result.mosaic_is_partial:
            print(f"It has no data where tiles failed; {run / 'failed.gpkg'} has their outlines and reasons.")
