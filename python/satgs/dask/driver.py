"""Submits the jobs of a plan to a Dask cluster and decides what follows from their ends.

As many jobs are submitted as there are workers for them, and no more: jobs that wait in the queue of a worker that is
killed would count as suspects of its death and be given up by Dask after some deaths that they had no part in.
"""

from __future__ import annotations

import queue
import time
import uuid
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from distributed import Client, Future, KilledWorker

from . import job
from .job import Outcome
from .plan import PlanError, Tile, is_done, read_plan, write_failure
from .progress import Progress

BLEND_MB = 500.0
"""Memory that a blend or the mosaic asks of a worker, megabytes."""

RETRY_DELAY = 1.0
"""Seconds before a job that failed is tried again."""

LOCK_SECONDS = 60.0
"""Time for which another program may be at work on the same tile before that counts as a failure, seconds. The program
of a worker that was killed writes a checkpoint before it ends."""

WORKER_SECONDS = 60.0
"""Time for which jobs that no worker can take wait for one that can, seconds: workers join one after the other."""

LOST = "the connection with the scheduler was lost"


@dataclass(frozen=True)
class Settings:
    """How the jobs are run."""

    satgs: str = "satgs"
    """The program, as the workers find it."""
    threads: int | None = None
    """Threads of each process; by default the program's own choice, one per core of the machine."""
    retries: int = 2
    """How often a job that failed is tried again."""
    only: tuple[str, ...] = ()
    """IDs of the tiles to be made; all of the plan's tiles if empty."""


@dataclass
class TileResult:
    """What became of a tile."""

    id: str
    state: str = "waiting"
    """`waiting`, `done` or `failed`."""
    attempts: int = 0
    seconds: float = 0.0
    """Time of the last attempt."""
    reason: str = ""
    """Why it failed."""


@dataclass
class Result:
    """What became of a call."""

    tiles: dict[str, TileResult]
    """All tiles of the plan."""
    selected: tuple[str, ...]
    """The tiles that were to be made."""
    mosaic: str = "waiting"
    """`done`, `waiting` (for tiles that were not selected), or why it failed."""
    mosaic_is_partial: bool = False
    """Whether the mosaic has no data where tiles failed."""

    @property
    def exit_code(self) -> int:
        """0 done, 3 some tiles failed or are empty in the mosaic, 1 nothing was made."""
        states = {self.tiles[name].state for name in self.selected}
        if states == {"failed"} or self.mosaic not in ("done", "waiting"):
            return 1
        return 3 if "failed" in states or self.mosaic_is_partial else 0


@dataclass(eq=False)
class _Work:
    """A job that is to be done, or under way."""

    kind: str
    tile: str
    seconds: float
    """Predicted time: the longest jobs start first, so that none is left for the end."""
    memory_mb: float
    failures: int = 0
    attempts: int = 0
    not_before: float = 0.0
    locked_since: float | None = None


def run_tiles(
    client: Client, run: str | Path, settings: Settings | None = None, stream: IO[str] | None = None
) -> Result:
    """Makes the tiles of a plan on the workers of a Dask client, blends them and makes the mosaic.

    Tiles that are done are left as they are. A tile that fails does not stop the others.

    Args:
        client: a client of a cluster whose workers have the resources ``tile=1`` and ``MEM``, the memory in megabytes.
        run: the run folder with ``tiles.json``, under a path that is the same on all workers.
        settings: how the jobs are run.
        stream: receives one line of progress, by default none.

    Raises:
        PlanError: there is no plan, or the plan has no tile of a given ID, or no worker has the resources.
        ConnectionError: the scheduler was lost; what is done is kept.
        KeyboardInterrupt: after Ctrl-C, when the programs on the workers have ended.
    """
    settings = settings or Settings()
    run = Path(run).absolute()
    plan = read_plan(run)
    unknown = [name for name in settings.only if name not in plan]
    if unknown:
        raise PlanError(f"the plan has no tile `{unknown[0]}`\nhint: `satgs tile status {run}` lists the tiles")
    return _Driver(client, run, plan, settings, stream).drive()


class _Driver:
    def __init__(self, client: Client, run: Path, plan: dict[str, Tile], settings: Settings, stream: IO[str] | None):
        self.client: Any = client
        self.run = run
        self.plan = plan
        self.settings = settings
        self.topic = f"satgs-{uuid.uuid4().hex}"
        self.ends: queue.Queue[tuple[_Work, Outcome | BaseException] | dict[str, Any]] = queue.Queue()
        self.waiting: list[_Work] = []
        self.running: dict[_Work, Any] = {}
        """The jobs under way, with their futures."""
        tiles = {name: TileResult(name) for name in plan}
        self.result = Result(tiles, tuple(dict.fromkeys(settings.only)) or tuple(plan))
        self.progress = Progress(run, plan, (tiles[name] for name in self.result.selected), stream)
        self.largest_mb = 0.0
        """Memory of the largest worker, at the last time when there was one."""
        self.stuck_since: float | None = None

    def drive(self) -> Result:
        tiles = self.result.tiles
        for name, tile in self.plan.items():
            if is_done(self.run, tile):
                tiles[name].state = "done"
            elif name in self.result.selected:
                self.waiting.append(_Work("tile", name, tile.seconds, tile.memory_mb))
        self.client.subscribe_topic(self.topic, lambda event: self.ends.put(event[1]))
        try:
            for name in self.plan:
                self._blend_if_ready(name)
            self._loop()
            states = {tile.state for tile in tiles.values()}
            if "waiting" not in states and "done" in states:
                self.waiting.append(_Work("mosaic", "", 0.0, BLEND_MB))
                self._loop()
        except BaseException:
            with suppress(Exception):
                self.progress.note("the programs on the workers are stopped")
            # Without a scheduler the workers end, and their programs with them.
            if self.client.status == "running":
                with suppress(Exception):
                    self.client.run(job.stop, self.topic, on_error="ignore")
            raise
        finally:
            with suppress(Exception):
                self.client.unsubscribe_topic(self.topic)
            self.progress.close()
        return self.result

    def _loop(self) -> None:
        """Starts jobs and takes their ends until none is left."""
        looked_at = 0.0
        while self.waiting or self.running:
            # Workers come and go, so that the cluster is looked at every second even if no job has ended.
            if time.monotonic() - looked_at > 1.0:
                looked_at = time.monotonic()
                self._start()
            try:
                item = self.ends.get(timeout=1.0)
            except queue.Empty:
                if self.client.status == "closed":
                    raise ConnectionError(LOST) from None
            else:
                if isinstance(item, dict):
                    self.progress.event(item)
                else:
                    self._end(*item)
                    looked_at = 0.0
            self.progress.show([work.tile for work in self.running if work.kind == "tile"])

    def _start(self) -> None:
        """Starts the longest jobs for which there are workers, and gives up jobs for which no worker has come in time.

        Raises:
            PlanError: there are workers, but for some time none that declares the resources.
        """
        workers = self.client.sync(self.client.scheduler.identity, n_workers=-1)["workers"].values()
        slots = _slots(workers)
        self.progress.slots = len(slots)
        self.largest_mb = slots[0] if slots else self.largest_mb
        # A job that no worker can hold has lost its worker, and waits in the scheduler for another one.
        in_use = [self._needed(work) for work in self.running if slots and self._needed(work) <= slots[0]]
        is_stuck = bool(workers) and not in_use
        self.waiting.sort(key=lambda work: -work.seconds)
        for work in list(self.waiting):
            needed = self._needed(work)
            if slots and needed <= slots[0]:
                is_stuck = False
                if work.not_before <= time.monotonic() and _fit([needed, *in_use], slots):
                    in_use.append(needed)
                    self.waiting.remove(work)
                    self._submit(work, needed)
        if not is_stuck:
            self.stuck_since = None
        elif self.stuck_since is None:
            self.stuck_since = time.monotonic()
            self.progress.note(f"no worker can take a job; one may come within {WORKER_SECONDS:.0f} s")
        elif time.monotonic() - self.stuck_since < WORKER_SECONDS:
            return
        elif slots:
            for work in [*self.waiting, *self.running]:
                self._fail(work, f"needs {work.memory_mb:.0f} MB; the largest worker has {slots[0]:.0f} MB")
        elif self.largest_mb == 0.0:
            raise PlanError(
                "no worker of the cluster has the resources `tile` and `MEM`\n"
                "hint: `dask worker SCHEDULER --nthreads 1 --resources tile=1,MEM=4000`, with the memory in megabytes"
            )

    def _needed(self, work: _Work) -> float:
        """Memory that a job asks for, megabytes; blends and the mosaic take the largest worker that there is."""
        return work.memory_mb if work.kind == "tile" else min(work.memory_mb, self.largest_mb)

    def _submit(self, work: _Work, memory_mb: float) -> None:
        work.attempts += 1
        folder = self.run / "tiles" / work.tile if work.tile else self.run
        future = self.client.submit(
            job.run,
            self._command(work),
            folder / ("error.log" if work.kind == "tile" else f"{work.kind}-error.log"),
            self.topic,
            {"job": work.kind, "tile": work.tile, "attempt": work.attempts},
            key=f"{work.kind}-{work.tile or 'all'}-{work.attempts}-{self.topic}",
            resources={"tile": 1, "MEM": memory_mb},
            pure=False,
        )
        self.running[work] = future
        if work.kind == "tile":
            self.result.tiles[work.tile].attempts = work.attempts

        def ended(future: Future[Any]) -> None:
            try:
                self.ends.put((work, future.result()))
            except BaseException as error:  # Also `CancelledError`, when the scheduler is gone.
                self.ends.put((work, error))

        future.add_done_callback(ended)

    def _command(self, work: _Work) -> list[str]:
        words = {"tile": ["tile", "run"], "blend": ["tile", "blend"], "mosaic": ["mosaic"]}[work.kind]
        command = [self.settings.satgs, *words, str(self.run), *([work.tile] if work.tile else [])]
        command += ["--exit-with-parent", "--events"]
        if work.kind == "blend":
            for name in self.plan[work.tile].neighbours:
                command += ["--without", name] if self.result.tiles[name].state == "failed" else []
        if self.settings.threads is not None:
            command += ["--threads", str(self.settings.threads)]
        return command

    def _end(self, work: _Work, outcome: Outcome | BaseException) -> None:
        """Takes the end of a job: it is done, tried again, or given up."""
        if self.running.pop(work, None) is None:
            return  # It was given up before.
        if isinstance(outcome, KilledWorker):
            return self._fail(work, "the workers that tried it died, one after the other")
        if isinstance(outcome, BaseException):
            if self.client.status != "running":
                raise ConnectionError(LOST) from outcome
            outcome = Outcome(126, 0.0, f"error: {outcome!r}")
        if work.kind == "tile":
            self.result.tiles[work.tile].seconds = outcome.seconds
        if outcome.code in (0, 3):
            return self._succeed(work, outcome)
        reason = outcome.reason
        if outcome.lacks_memory:
            more = min(2.0 * work.memory_mb, self.largest_mb)
            if more <= work.memory_mb:
                reason += f"; the largest worker has {self.largest_mb:.0f} MB"
                return self._fail(work, reason, outcome.is_by_program)
            work.memory_mb = more
        elif outcome.is_locked and time.monotonic() - (work.locked_since or time.monotonic()) < LOCK_SECONDS:
            work.locked_since = work.locked_since or time.monotonic()
        else:
            work.failures += 1
            if outcome.code == 2 or work.failures > self.settings.retries:
                return self._fail(work, reason, outcome.is_by_program)
        self.progress.note(f"{work.kind} {work.tile}: {reason}; it is tried again")
        work.not_before = time.monotonic() + RETRY_DELAY
        self.waiting.append(work)

    def _succeed(self, work: _Work, outcome: Outcome) -> None:
        if work.kind == "tile":
            self.result.tiles[work.tile].state = "done"
            self.progress.finished(work.tile, outcome.seconds)
            self._blend_around(work.tile)
        elif work.kind == "blend":
            self.progress.blended += 1
        else:
            self.result.mosaic = "done"
            self.result.mosaic_is_partial = outcome.code == 3

    def _fail(self, work: _Work, reason: str, is_recorded: bool = False) -> None:
        """Gives a job up. `is_recorded`: the program has written a reason of its own into the tile's folder."""
        if work in self.waiting:
            self.waiting.remove(work)
        future = self.running.pop(work, None)
        if future is not None:
            future.cancel()
        self.progress.note(f"{work.kind} {work.tile}: {reason}; it is given up after {work.attempts} attempts")
        if work.kind == "mosaic":
            self.result.mosaic = reason
        if work.kind != "tile":
            return  # The mosaic blends what is not blended yet, and tells whether that fails.
        tile = self.result.tiles[work.tile]
        tile.state, tile.reason = "failed", reason
        try:
            write_failure(self.run, work.tile, reason, is_recorded)
        except OSError as error:
            self.progress.cannot_write(error)
        self._blend_around(work.tile)

    def _blend_around(self, name: str) -> None:
        """Blends a tile and its neighbours as far as they waited for this one."""
        for other in (name, *self.plan[name].neighbours):
            self._blend_if_ready(other)

    def _blend_if_ready(self, name: str) -> None:
        tiles = self.result.tiles
        if tiles[name].state == "done" and all(tiles[n].state != "waiting" for n in self.plan[name].neighbours):
            self.waiting.append(_Work("blend", name, 0.0, BLEND_MB))


def _slots(workers: Iterable[dict[str, Any]]) -> list[float]:
    """Memory of each job that the workers can run at once, megabytes, the largest first."""
    slots: list[float] = []
    for worker in workers:
        resources = worker["resources"]
        count = min(int(resources.get("tile", 0)), int(worker["nthreads"]))
        slots += [resources.get("MEM", 0.0) / max(count, 1)] * count if "MEM" in resources else []
    return sorted(slots, reverse=True)


def _fit(needed: Sequence[float], slots: Sequence[float]) -> bool:
    """Whether jobs that need so much memory can run at once in slots of so much memory, largest first."""
    ordered = sorted(needed, reverse=True)
    return len(ordered) <= len(slots) and all(need <= slot for need, slot in zip(ordered, slots, strict=False))
