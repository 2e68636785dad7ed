"""What the driver reads from a run folder: the plan and which of its tiles are done."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

SCHEMA = 2
"""The version of ``tiles.json`` that this module reads."""


class PlanError(Exception):
    """The plan is missing or unreadable, or the request does not fit it; the user has to change something."""


@dataclass(frozen=True)
class Tile:
    """A tile of the plan."""

    id: str
    neighbours: tuple[str, ...]
    seconds: float
    """Predicted time on two cores."""
    memory_mb: float
    """Predicted peak memory, megabytes."""
    input_hash: str


def read_plan(run: Path) -> dict[str, Tile]:
    """Reads ``tiles.json``: the tiles by their ID, in the plan's order.

    Raises:
        PlanError: the file is missing, or is not a plan of the version that this module reads.
    """
    path = run / "tiles.json"
    try:
        plan: Any = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise PlanError(f"`{path}` does not exist\nhint: `satgs plan SCENE -o {run}` makes it") from None
    except (OSError, ValueError) as error:
        raise PlanError(f"`{path}` cannot be read: {error}") from error
    try:
        if plan["schema"] != SCHEMA:
            raise PlanError(
                f"`{path}` has schema {plan['schema']}; this satgs-dask reads schema {SCHEMA}\n"
                "hint: install the Python package and the program satgs of the same version"
            )
        tiles = [
            Tile(
                id=str(tile["id"]),
                neighbours=tuple(tile["neighbours"]),
                seconds=float(tile["cost"]["seconds_2core"]),
                memory_mb=float(tile["cost"]["memory_mb"]),
                input_hash=str(tile["input_hash"]),
            )
            for tile in plan["tiles"]
        ]
    except (KeyError, TypeError, ValueError) as error:
        raise PlanError(f"`{path}` is not a plan of tiles: {error!r}") from error
    by_id = {tile.id: tile for tile in tiles}
    unknown = {name for tile in tiles for name in tile.neighbours} - by_id.keys()
    if not tiles or unknown:
        raise PlanError(f"`{path}`: " + (f"no tile is named {sorted(unknown)[0]}" if tiles else "it has no tiles"))
    return by_id


def is_done(run: Path, tile: Tile) -> bool:
    """Whether the tile was made from the present plan and its files have the sizes that ``done.json`` lists."""
    folder = run / "tiles" / tile.id
    try:
        done: Any = json.loads((folder / "done.json").read_text(encoding="utf-8"))
        sizes = {name: file["bytes"] for name, file in done["files"].items()}
        are_sound = bool(sizes) and all((folder / name).stat().st_size == size for name, size in sizes.items())
        return are_sound and bool(done["input_hash"] == tile.input_hash)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return False


def write_failure(run: Path, tile: str, reason: str, is_recorded: bool) -> None:
    """Writes a tile's ``failed.json``, the reason in the mosaic, unless the program has recorded the failure there.

    Raises:
        OSError: it cannot be written.
    """
    path = run / "tiles" / tile / "failed.json"
    if is_recorded and path.exists():
        return
    temporary = path.with_name(f".failed.json.{os.getpid()}")
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary.write_text(json.dumps({"reason": reason}), encoding="utf-8")
    os.replace(temporary, path)
