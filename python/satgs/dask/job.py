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

_REASONS = {2: "its input or options are wrong", 75: "not enough memory or disk", 130: "it was interrupted"}

_processes: dict[str, set[subprocess.Popen[str]]] = defaultdict(set)
"""The processes of this worker, by the topic of the call that they belong to."""
_stopped: set[str] = set()
"""Topics of calls that were interrupted: their jobs must not start any more."""
_guard = threading.Lock()


@dataclass(frozen=True)
class Outcome:
    """How a command ended."""

    code: int
    """Exit code; negative: the signal that ended the process."""
    seconds: float
    last_lines: str
    """The last lines of standard error."""

    @property
    def reason(self) -> str:
        """The exit code or signal of a job that failed, and its error message if it left one."""
        if self.code < 0:
            names = {item.value: item.name for item in signal.Signals}
            return f"ended by signal {names.get(-self.code, -self.code)}"
        lines = [line.strip() for line in self.last_lines.splitlines() if line.strip()]
        errors = [line.removeprefix("error:").strip() for line in lines if line.startswith("error:")]
        said = (errors or lines)[-1:]
        return ": ".join([f"{_REASONS.get(self.code, 'failed')} (exit code {self.code})", *said])

    @property
    def is_by_program(self) -> bool:
        """Whether the program ended by itself with an error of the tile, which it then wrote to ``failed.json``."""
        return 0 < self.code < 126 and not self.is_locked

    @property
    def is_locked(self) -> bool:
        """Whether another program is at work on the tile."""
        return self.code == 1 and "another satgs is at work" in self.last_lines

    @property
    def lacks_memory(self) -> bool:
        """Whether the machine had too little memory. Too little disk space has the same exit code."""
        return self.code == 75 and "of memory" in self.last_lines


def run(command: list[str], log: Path, topic: str, about: dict[str, Any]) -> Outcome:
    """Runs the command of a job to its end, on a worker.

    The process holds the reading end of a pipe from this worker as its standard input. With ``--exit-with-parent`` it
    ends when that pipe closes, that is, also when this worker is killed.

    Args:
        command: the program and its arguments.
        log: file that receives standard error if the command fails.
        topic: topic of the events, unique to the call of :func:`run_tiles`.
        about: what each event says about the job: its kind, tile and attempt.
    """
    worker: Any = get_worker()
    started = time.monotonic()

    def send(event: dict[str, Any]) -> None:
        worker.log_event(topic, {"time": time.time(), "worker": worker.address, **about, **event})

    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as errors:
        pipe = subprocess.PIPE
        try:
            with _guard:
                if topic in _stopped:
                    return Outcome(130, 0.0, "")
                # In a session of its own, so that Ctrl-C in a terminal reaches it once, through `stop`.
                process = subprocess.Popen(
                    command,
                    stdin=pipe,
                    stdout=pipe,
                    stderr=errors,
                    text=True,
                    errors="replace",
                    start_new_session=True,
                )
                _processes[topic].add(process)
        except OSError as error:
            return Outcome(127, 0.0, f"`{command[0]}` cannot be started on {worker.address}: {error}")
        with process:
            try:
                send({"event": "job-started", "pid": process.pid})
                _forward(process, send)
                code = process.wait()
            finally:
                _end(process)
                with _guard:
                    _processes[topic].discard(process)
        seconds = time.monotonic() - started
        send({"event": "job-ended", "code": code, "seconds": round(seconds, 3)})
        errors.seek(0)
        said = errors.read()
    try:
        if code in (0, 3):
            log.unlink(missing_ok=True)
        else:
            log.parent.mkdir(parents=True, exist_ok=True)
            header = f"{' '.join(command)}\nattempt {about['attempt']} on {worker.address}: exit code {code}\n"
            log.write_text(header + said, encoding="utf-8")
    except OSError:
        pass  # The log is a copy of what the client is told anyway, and a full disk may be why the job failed.
    return Outcome(code, seconds, "\n".join(said.splitlines()[-LAST_LINES:]))


def _forward(process: subprocess.Popen[str], send: Any) -> None:
    """Sends the events that a process prints; of the frequent ones not more than one a second."""
    last_sent = 0.0
    for line in process.stdout or ():
        try:
            event = json.loads(line)
        except ValueError:
            continue  # Output that is not an event, of a program that the command called.
        if not isinstance(event, dict) or event.get("event") == "summary":
            continue  # The summary is long, and in the job's files.
        if event.get("event") == "advanced":
            if time.monotonic() - last_sent < 1.0:
                continue
            last_sent = time.monotonic()
        send(event)


def _end(process: subprocess.Popen[str]) -> None:
    """Interrupts a process if it has not ended, and kills it if it does not end in time."""
    process.terminate()  # Does nothing if it has ended.
    try:
        process.wait(STOP_SECONDS)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


async def stop(topic: str) -> None:
    """Interrupts the processes of a call on this worker, and kills those that do not end in time."""
    with _guard:
        _stopped.add(topic)
        processes = list(_processes[topic])
    await asyncio.gather(*(asyncio.to_thread(_end, process) for process in processes))
