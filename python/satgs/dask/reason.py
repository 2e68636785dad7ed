"""Why a job failed, in words."""

from __future__ import annotations

import signal

from .job import Outcome

_CODES = {
    2: "its input or options are wrong",
    75: "not enough memory or disk",
    130: "it was interrupted",
}


def reason_of(outcome: Outcome) -> str:
    """The exit code or signal of a job that failed, and its error message if it left one."""
    if outcome.code < 0:
        try:
            name = signal.Signals(-outcome.code).name
        except ValueError:
            name = str(-outcome.code)
        return f"ended by signal {name}"
    lines = [line.strip() for line in outcome.last_lines.splitlines() if line.strip()]
    errors = [line.removeprefix("error:").strip() for line in lines if line.startswith("error:")]
    said = errors[-1] if errors else lines[-1] if lines else ""
    what = _CODES.get(outcome.code, "failed")
    return f"{what} (exit code {outcome.code})" + (f": {said}" if said else "")


def is_locked(outcome: Outcome) -> bool:
    """Whether a job failed because another program is at work on its tile."""
    return outcome.code == 1 and "another satgs is at work" in outcome.last_lines
