"""Starting `satgs-dask` as a process, and waiting for what it does."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import psutil


def until(condition: Callable[[], bool], seconds: float = 30.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "the time is over"
        time.sleep(0.05)


def assert_no_process_is_left(run: Path) -> None:
    def left() -> list[psutil.Process]:
        return [p for p in psutil.process_iter(["cmdline"]) if str(run) in (p.info["cmdline"] or [])]

    until(lambda: not left(), 10.0)


def command(run: Path, satgs: str, *options: str) -> subprocess.Popen[str]:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.Popen(
        [sys.executable, "-m", "satgs.dask", str(run), "--satgs", satgs, *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        start_new_session=True,
    )
