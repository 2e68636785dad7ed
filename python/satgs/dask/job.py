"""What runs on a worker: one ``satgs`` process, whose events are forwarded to the client."""

from __future__ import annotations

import asyncio
import json
import signal
import subprocess
import tempfile
import threading
import time
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from distributed import get_worker

LAST_LINES = 20
"""Lines of standard error that a failed job sends to the client; all of them are in its log."""

STOP_SECONDS = 30.0
"""Time that an interrupted process has for writing its checkpoint."""

_FORWARD_EVERY = 1.0
"""Seconds between two forwarded events of the kind `advanced`."""

_processes: dict[str, set[subprocess.Popen[str]]] = defaultdict(set)
"""The processes of this worker, by the topic of the call that they belong to."""
_stopped: set[str] = set()
"""Topics of calls that were interrupted: their jobs must not start any more."""
_guard = threading.Lock()


@dataclass(frozen=True)
class Job:
    """A command to be run on a worker."""

    kind: str
    """`tile`, `blend` or `mosaic`."""
    tile: str
    """ID of the tile; empty for the mosaic."""
    attempt: int
    command: tuple[str, ...]
    log: str
    """File that receives standard error if the command fails."""
    topic: str
    """Topic of the events, unique to the call."""


@dataclass(frozen=True)
class Outcome:
    """How a command ended."""

    code: int
    """Exit code; negative: the signal that ended the process."""
    seconds: float
    worker: str
    last_lines: str
    """The last lines of standard error."""


def run(job: Job) -> Outcome:
    """Runs a job's command to its end, on a worker.

    The process holds the reading end of a pipe from this worker as its standard input. With ``--exit-with-parent`` it
    ends when that pipe closes, that is, also when this worker is killed.
    """
    worker: Any = get_worker()
    where = str(worker.address)
    started = time.monotonic()

    def send(event: dict[str, Any]) -> None:
        about = {"job": job.kind, "tile": job.tile, "attempt": job.attempt, "worker": where}
        worker.log_event(job.topic, {"time": time.time(), **about, **event})

    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as errors:
        pipe = subprocess.PIPE
        try:
            with _guard:
                if job.topic in _stopped:
                    return Outcome(130, 0.0, where, "interrupted")
                # In a session of its own, so that Ctrl-C in a terminal reaches it once, through `stop`.
                process = subprocess.Popen(
                    job.command,
                    stdin=pipe,
                    stdout=pipe,
                    stderr=errors,
                    text=True,
                    errors="replace",
                    start_new_session=True,
                )
                _processes[job.topic].add(process)
        except OSError as error:
            return Outcome(127, 0.0, where, f"`{job.command[0]}` cannot be started on {where}: {error}")
        try:
            send({"event": "job-started", "pid": process.pid})
            _forward(process, send)
            code = process.wait()
        finally:
            process.kill()  # Does nothing if it has ended.
            with _guard:
                _processes[job.topic].discard(process)
        seconds = time.monotonic() - started
        send({"event": "job-ended", "code": code, "seconds": round(seconds, 3)})
        errors.seek(0)
        said = errors.read()
    _write_log(job, code, where, said)
    return Outcome(code, seconds, where, "\n".join(said.splitlines()[-LAST_LINES:]))


def _forward(process: subprocess.Popen[str], send: Any) -> None:
    """Sends the events that a process prints; of the frequent ones not more than one a second."""
    assert process.stdout is not None
    last_sent = 0.0
    for line in process.stdout:
        try:
            event = json.loads(line)
        except ValueError:
            continue  # Output that is not an event, of a program that the command called.
        if not isinstance(event, dict) or event.get("event") == "summary":
            continue  # The summary is long, and in the job's files.
        if event.get("event") == "advanced":
            if time.monotonic() - last_sent < _FORWARD_EVERY:
                continue
            last_sent = time.monotonic()
        send(event)


def _write_log(job: Job, code: int, where: str, said: str) -> None:
    """Keeps what a failed process said; the log of a job that succeeded is removed."""
    path = Path(job.log)
    try:
        if code in (0, 3):
            path.unlink(missing_ok=True)
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            header = f"{' '.join(job.command)}\nattempt {job.attempt} on {where}: exit code {code}\n"
            path.write_text(header + said, encoding="utf-8")
    except OSError:
        pass  # The log is a copy of what the client is told anyway, and a full disk may be why the job failed.


async def stop(topic: str) -> None:
    """Interrupts the processes of a call on this worker, and kills those that do not end in time."""
    with _guard:
        _stopped.add(topic)
        processes = list(_processes[topic])
    for process in processes:
        process.send_signal(signal.SIGTERM)
    deadline = time.monotonic() + STOP_SECONDS
    while any(process.poll() is None for process in processes) and time.monotonic() < deadline:
        await asyncio.sleep(0.05)
    for process in processes:
        process.kill()
