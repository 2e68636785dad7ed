"""One line of progress on the terminal, and all events in ``events.jsonl``."""

from __future__ import annotations

import json
import shutil
import time
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from .plan import Tile

if TYPE_CHECKING:
    from .driver import TileResult


class Progress:
    """Shows how far the tiles are.

    The predicted time left is the plan's prediction, corrected by the tiles that have finished in this call.
    """

    def __init__(self, run: Path, plan: dict[str, Tile], tiles: dict[str, TileResult], stream: IO[str] | None):
        self.slots = 0
        """Jobs that the cluster can run at once."""
        self.blended = 0
        self._plan = plan
        self._tiles = tiles
        self._stream = stream
        self._events = (run / "events.jsonl").open("a", encoding="utf-8")
        self._stages: dict[str, str] = {}
        self._predicted = 0.0
        self._taken = 0.0
        self._shown = ""
        self._shown_at = 0.0

    def event(self, event: dict[str, Any]) -> None:
        """Records an event of a job."""
        self._events.write(json.dumps(event) + "\n")
        self._events.flush()
        tile = str(event.get("tile", ""))
        if event.get("event") == "started":
            self._stages[tile] = str(event.get("stage", ""))
        elif event.get("event") == "warning":
            self.note(f"{tile}: warning: {event.get('text', '')}")

    def note(self, text: str) -> None:
        """Says something once, above the line of progress."""
        self._events.write(json.dumps({"time": time.time(), "event": "note", "text": text}) + "\n")
        self._events.flush()
        if self._stream is not None:
            self._clear()
            print(text, file=self._stream, flush=True)

    def finished(self, tile: str, seconds: float) -> None:
        """Corrects the prediction by a tile that is done."""
        self._predicted += self._plan[tile].seconds
        self._taken += seconds

    def show(self, running: list[str]) -> None:
        """Shows the line: on a terminal at most five times a second, elsewhere whenever a tile ends."""
        if self._stream is None:
            return
        states = [tile.state for tile in self._tiles.values()]
        counts = f"tiles: {states.count('done')} of {len(states)} done, {len(running)} running"
        if "failed" in states:
            counts += f", {states.count('failed')} failed"
        if not self._stream.isatty():
            settled = f"{states.count('waiting')}"
            if settled != self._shown:
                self._shown = settled
                print(counts + self._left(running), file=self._stream, flush=True)
            return
        if time.monotonic() - self._shown_at < 0.2:
            return
        self._shown_at = time.monotonic()
        line = f"{counts}; {self.blended} blended{self._left(running)}"
        if not self.slots:
            line += "; waiting for a worker"
        stages = [f"{tile} {self._stages[tile]}" for tile in running if tile in self._stages]
        line = "; ".join([line, *stages])[: shutil.get_terminal_size().columns - 1]
        self._clear()
        self._stream.write(line)
        self._stream.flush()
        self._shown = line

    def close(self) -> None:
        """Ends the line and closes the file of events."""
        self._clear()
        self._events.close()

    def _clear(self) -> None:
        if self._stream is not None and self._stream.isatty() and self._shown:
            self._stream.write("\r\x1b[K")
            self._shown = ""

    def _left(self, running: list[str]) -> str:
        factor = self._taken / self._predicted if self._predicted > 0.0 else 1.0
        left = [self._plan[name].seconds * factor for name, tile in self._tiles.items() if tile.state == "waiting"]
        # Tiles that are running count half: on average half of each is done.
        total = sum(left) - 0.5 * factor * sum(self._plan[name].seconds for name in running)
        seconds = max([total / max(self.slots, 1), *(0.5 * each for each in left)]) if left else 0.0
        return f"; about {_duration(seconds)} left" if seconds > 0.0 else ""


def _duration(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    if seconds < 5400.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h"
