"""Runs for the stand-in for satgs, and what it did."""

from __future__ import annotations

import json
import stat
import sys
from collections import Counter
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent


def write_program(folder: Path) -> str:
    """Writes the stand-in as an executable named satgs."""
    program = folder / "bin" / "satgs"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -I -S "{HERE / "stand_in_satgs.py"}" "$@"\n')
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    return str(program)


def write_plan(run: Path, behaviour: dict[str, Any] | None = None, columns: int = 3, memory_mb: float = 100.0) -> None:
    """Writes a plan of two rows of tiles."""
    places = {f"x{x:03}_y{y:03}": (x, y) for y in range(2) for x in range(columns)}
    tiles = [
        {
            "id": name,
            "neighbours": [n for n, (u, v) in places.items() if n != name and abs(u - x) <= 1 and abs(v - y) <= 1],
            "cost": {"seconds_2core": 10.0 + x, "memory_mb": memory_mb, "read_mb": 1.0},
            "input_hash": f"{x}{y}" * 16,
        }
        for name, (x, y) in places.items()
    ]
    run.mkdir(exist_ok=True)
    (run / "tiles.json").write_text(json.dumps({"schema": 2, "satgs": "0.1.0", "plan_hash": "0", "tiles": tiles}))
    (run / "behaviour.json").write_text(json.dumps(behaviour or {}))


def attempts(run: Path) -> list[list[str]]:
    """Attempts of the stand-in: words of its log's lines."""
    path = run / "attempts.log"
    return [line.split() for line in path.read_text().splitlines()] if path.exists() else []


def tile_attempts(run: Path) -> Counter[str]:
    return Counter(words[1] for words in attempts(run) if words[0] == "tile")
