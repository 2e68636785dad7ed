"""Ctrl-C during a training: a checkpoint is left, and the next call ends with the same bytes."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import satgs

ITERATIONS = 120
TRAIN = f"""
import sys, satgs
def progress(event):
    if isinstance(event, satgs.events.Advanced):
        print(event.done, flush=True)
satgs.train(sys.argv[1], iterations={ITERATIONS}, progress=progress)
"""


def interrupt(process: subprocess.Popen[str], at: int) -> str:
    """Sends SIGINT once so many iterations are done; returns what the process wrote to standard error."""
    assert process.stdout is not None
    for line in process.stdout:
        if int(line) >= at and process.poll() is None:
            process.send_signal(signal.SIGINT)
            break
    return process.communicate(timeout=120)[1]


def test_an_interrupted_training_ends_with_the_same_bytes(run: Path, tmp_path: Path) -> None:
    whole = Path(shutil.copytree(run, tmp_path / "whole"))
    satgs.train(whole, iterations=ITERATIONS)
    for at in [20, 60]:
        command = [sys.executable, "-c", TRAIN, str(run)]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        said = interrupt(process, at)
        # As an interrupted program of Python ends.
        assert process.returncode == -signal.SIGINT and "KeyboardInterrupt" in said, said
        assert (run / "train" / "checkpoint.bin").is_file() and not (run / "splats.ply").exists()
    satgs.train(run, iterations=ITERATIONS)
    assert (run / "splats.ply").read_bytes() == (whole / "splats.ply").read_bytes()


def test_the_command_of_the_package_works_and_handles_interrupts(run: Path) -> None:
    command = str(Path(sys.executable).with_name("satgs"))
    version = subprocess.run([command, "--version"], capture_output=True, text=True, check=True)
    assert version.stdout == f"satgs {satgs.__version__}\n"
    assert subprocess.run([command, "train"], capture_output=True).returncode == 2
    arguments = [command, "train", str(run), "--iterations", "20000", "--checkpoint-every", "20"]
    process = subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True)
    checkpoint = run / "train" / "checkpoint.bin"
    # The first checkpoint tells that it trains.
    while not checkpoint.exists() and process.poll() is None:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=120)
    assert process.returncode == 130 and "interrupted: keeping what is done" in said, said
