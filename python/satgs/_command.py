"""The command line of the package: ``satgs``."""

from __future__ import annotations

import signal
import sys

from satgs import _satgs


def main() -> int:
    """Runs the command line of this process and returns the exit code."""
    # Interrupts are the command's own business: it writes a checkpoint.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _satgs.command(["satgs", *sys.argv[1:]])
