"""One line of progress on the terminal, and all events in ``events.jsonl``."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Iterable
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from .plan import Tile

if TYPE_CHECKING:
    from .driver import TileResult


class Progress:
    """Shows how far the tiles are.

    The predicted time left is the plan's prediction, corrected by the tiles that have finished in this call.
    """

    def __init__(self, run: Path, plan: dict[str, Tile], tiles: Iterable[TileResult], stream: IO[str] | None):
        self.slots = 0
        """Jobs that the cluster can run at once."""
        self.blended = 0
        self._plan = plan
        self._tiles = list(tiles)
        self._stream = stream
        self._stages: dict[str, str] = {}
        self._predicted = 0.0
        self._taken = 0.0
        self._shown = ""
        self._shown_at = 0.0
        self._has_warned = False
        self._events: IO[bytes] | None = None
        try:
            self._events = (run / "events.jsonl").open("ab", buffering=0)
        except OSError as error:
            self.cannot_write(error)

    def event(self, event: dict[str, Any]) -> None:
        """Records an event of a job."""
        self._record(event)
        if event.get("event") == "started":
            self._stages[event["tile"]] = str(event.get("stage", ""))
        elif event.get("event") == "warning":
            self.note(f"{event['job']} {event['tile']}: warning: {event.get('text', '')}")

    def note(self, text: str) -> None:
        """Says something once, above the line of progress."""
        self._record({"time": time.time(), "event": "note", "text": text})
        if self._stream is not None:
            self._clear()
            print(text, file=self._stream, flush=True)

    def cannot_write(self, error: OSError) -> None:
        """Warns, once, that a record of the work is not complete; the work itself continues."""
        if not self._has_warned:
            self._has_warned = True
            self.note(f"warning: records of the work in the run folder cannot be written: {error}")

    def finished(self, tile: str, seconds: float) -> None:
        """Corrects the prediction by a tile that is done."""
        self._predicted += self._plan[tile].seconds
        self._taken += seconds

    def show(self, running: list[str]) -> None:
        """Shows the line: on a terminal at most five times a second, elsewhere whenever a tile ends."""
        if self._stream is None:
            return
        states = [tile.state for tile in self._tiles]
        line = f"tiles: {states.count('done')} of {len(states)} done, {len(running)} running"
        if "failed" in states:
            line += f", {states.count('failed')} failed"
        line += self._left(running)
        if not self._stream.isatty():
            settled = f"{states.count('waiting')}"
            if settled != self._shown:
                self._shown = settled
                print(line, file=self._stream, flush=True)
        elif time.monotonic() - self._shown_at > 0.2:
            self._shown_at = time.monotonic()
            line += f"; {self.blended} blended"
            waiting = [] if self.slots else ["waiting for a worker"]
            stages = [f"{tile} {self._stages[tile]}" for tile in running if tile in self._stages]
            self._clear()
            self._shown = "; ".join([line, *waiting, *stages])[: shutil.get_terminal_size().columns - 1]
            self._stream.write(self._shown)
            self._stream.flush()

    def close(self) -> None:
        """Ends the line and closes the file of events."""
        self._clear()
        if self._events is not None:
            self._events.close()

    def _record(self, event: dict[str, Any]) -> None:
        if self._events is not None:
            try:
                self._events.write(json.dumps(event).encode() + b"\n")
            except OSError as error:
                self._events = None
                self.cannot_write(error)

    def _clear(self) -> None:
        if self._stream is not None and self._stream.isatty() and self._shown:
            self._stream.write("\r\x1b[K")
            self._shown = ""

    def _left(self, running: list[str]) -> str:
        factor = self._taken / self._predicted if self._predicted > 0.0 else 1.0
        left = [self._plan[tile.id].seconds for tile in self._tiles if tile.state == "waiting"]
        # Tiles that are running count half: on average half of each is done.
        total = sum(left) - 0.5 * sum(self._plan[name].seconds for name in running)
        seconds = factor * max([total / max(self.slots, 1), *(0.5 * each for each in left)])
        if seconds < 90.0:
            duration = f"{seconds:.0f} s"
        else:
            duration = f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
        return f"; about {duration} left" if left else ""
