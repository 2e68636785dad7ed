"""`satgs-dask` with the program satgs, on a small scene of four tiles."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import psutil
import pytest

from supervision import assert_no_process_is_left, command, until

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.timeout(600)


@pytest.fixture
def satgs() -> str:
    """The program: $SATGS, that of the installed package, or a build in this repository."""
    built = [str(ROOT / "target" / kind / "satgs") for kind in ("release", "debug")]
    for program in (os.environ.get("SATGS", ""), str(Path(sys.executable).parent / "satgs"), *built):
        path = shutil.which(program)
        if path and subprocess.run([path, "tile", "--help"], capture_output=True, check=False).returncode == 0:
            return path
    pytest.skip("the program satgs is not built, or has no tiles")


def read_events(run: Path) -> list[dict[str, Any]]:
    path = run / "events.jsonl"
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def finish(run: Path, satgs: str) -> tuple[int, str]:
    process = command(run, satgs, "--local", "2", "--retries", "1")
    out, err = process.communicate(timeout=300)
    return process.returncode, out + err


def test_a_killed_worker_and_a_broken_tile_do_not_stop_the_others(tmp_path: Path, satgs: str) -> None:
    run = tmp_path / "run"
    scene = ROOT / "data" / "town"
    options = ["--core", "50", "--overlap", "10", "--iterations", "150"]
    subprocess.run([satgs, "plan", scene, "-o", run, *options, "--quiet"], check=True)
    plan_text = (run / "tiles.json").read_text()
    plan = json.loads(plan_text)
    names = [tile["id"] for tile in plan["tiles"]]
    assert len(names) == 4
    broken = names[1]
    plan["tiles"][1]["views"][0]["window"][0] = 100_000
    (run / "tiles.json").write_text(json.dumps(plan))

    process = command(run, satgs, "--local", "2", "--retries", "1")
    trained = [e for e in read_events(run) if e["event"] == "advanced"]

    def training() -> bool:
        nonlocal trained
        trained = [e for e in read_events(run) if e["event"] == "advanced" and "loss" in e["status"]]
        return bool(trained)

    until(training, 120.0)
    victim = trained[0]["tile"]
    pid = next(e["pid"] for e in read_events(run) if e["event"] == "job-started" and e["tile"] == victim)
    psutil.Process(pid).parent().send_signal(signal.SIGKILL)
    out, err = process.communicate(timeout=300)
    said = out + err
    assert process.returncode == 3, said
    assert_no_process_is_left(run)
    table = {line.split()[0]: line.split()[1] for line in out.splitlines() if line.startswith("x0")}
    assert table == {name: "failed" if name == broken else "done" for name in names}, said
    assert "window of view" in next(line for line in out.splitlines() if line.startswith(broken)), said
    starts = Counter(e["tile"] for e in read_events(run) if e["event"] == "job-started" and e["job"] == "tile")
    assert starts[victim] >= 2
    assert starts[broken] == 1
    assert (run / "failed.gpkg").exists()

    # The second call makes what is missing: the tile whose window is whole again, and what depends on it.
    (run / "tiles.json").write_text(plan_text)
    stamps = {name: (run / "tiles" / name / "done.json").stat().st_mtime_ns for name in names if name != broken}
    code, said = finish(run, satgs)
    assert code == 0, said
    assert stamps == {name: (run / "tiles" / name / "done.json").stat().st_mtime_ns for name in stamps}
    assert (run / "tiles" / broken / "done.json").exists()
    assert not (run / "failed.gpkg").exists()
    mosaic = (run / "dsm.tif").stat().st_mtime_ns
    code, said = finish(run, satgs)
    assert code == 0, said
    assert (run / "dsm.tif").stat().st_mtime_ns == mosaic
