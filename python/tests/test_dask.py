"""`satgs-dask` with a stand-in for the program satgs."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
from distributed import Client, LocalCluster, Nanny, Scheduler, SpecCluster
from supervision import assert_no_process_is_left, command, until

from satgs.dask import PlanError, Settings, driver, job, main, run_tiles
from satgs.dask.driver import _fit
from satgs.dask.plan import is_done, read_plan, write_failure
from satgs.dask.progress import Progress
from stand_in import attempts, tile_attempts, write_plan, write_program

pytestmark = pytest.mark.timeout(120)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return tmp_path / "run"


@pytest.fixture
def satgs(tmp_path: Path) -> str:
    return write_program(tmp_path)


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    """A cluster of two workers with 1000 and 400 MB."""
    options = {"nthreads": 1, "memory_limit": 0, "dashboard_address": ":0"}
    workers = {
        memory: {"cls": Nanny, "options": {**options, "resources": {"tile": 1, "MEM": memory}}}
        for memory in (1000, 400)
    }
    scheduler = {"cls": Scheduler, "options": {"dashboard_address": ":0"}}
    with SpecCluster(workers=workers, scheduler=scheduler) as cluster, Client(cluster, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=60)
        yield client


def test_all_tiles_are_made_blended_and_put_into_the_mosaic(client: Client, run: Path, satgs: str) -> None:
    write_plan(run)
    result = run_tiles(client, run, Settings(satgs=satgs))
    assert result.exit_code == 0
    assert {tile.state for tile in result.tiles.values()} == {"done"}
    assert result.mosaic == "done"
    assert sorted(tile_attempts(run).values()) == [1] * 6
    # Each tile was blended once, after its neighbours.
    kinds = Counter(words[0] for words in attempts(run))
    assert kinds == {"tile": 6, "blend": 6, "mosaic": 1}
    for name, tile in read_plan(run).items():
        assert json.loads((run / "mosaic" / f"{name}.json").read_text())["tiles"] == [name, *tile.neighbours]
    # The longest come first.
    assert {words[1] for words in attempts(run)[:2]} == {"x002_y000", "x002_y001"}
    events = [json.loads(line) for line in (run / "events.jsonl").read_text().splitlines()]
    assert Counter(e["event"] for e in events if e["job"] == "tile")["finished"] == 6
    assert all(e["worker"] and e["attempt"] == 1 for e in events)


def test_a_second_call_does_nothing_and_a_later_one_what_is_missing(client: Client, run: Path, satgs: str) -> None:
    write_plan(run)
    run_tiles(client, run, Settings(satgs=satgs))
    before = attempts(run)
    assert run_tiles(client, run, Settings(satgs=satgs)).exit_code == 0
    again = attempts(run)[len(before) :]
    assert {words[0] for words in again} == {"mosaic"}

    # A tile that was made from another plan, and one whose file is gone.
    (run / "tiles" / "x000_y000" / "done.json").write_text('{"input_hash": "of another plan"}')
    (run / "tiles" / "x001_y001" / "dsm.tif").unlink()
    assert run_tiles(client, run, Settings(satgs=satgs)).exit_code == 0
    missing = ("x000_y000", "x001_y001")
    assert tile_attempts(run) == {name: 2 if name in missing else 1 for name in read_plan(run)}


def test_a_tile_that_always_fails_is_given_up_after_its_retries(client: Client, run: Path, satgs: str) -> None:
    write_plan(run, {"x001_y000": {"exits": [1]}, "x000_y001": {"exits": [1, -signal.SIGKILL, 0]}})
    result = run_tiles(client, run, Settings(satgs=satgs))
    assert result.exit_code == 3
    assert tile_attempts(run) == {name: 3 if name in ("x001_y000", "x000_y001") else 1 for name in read_plan(run)}
    failed = result.tiles.pop("x001_y000")
    assert (failed.state, failed.attempts) == ("failed", 3)
    assert failed.reason == "failed (exit code 1): attempt 3 of x001_y000 is meant to fail"
    assert {tile.state for tile in result.tiles.values()} == {"done"}
    # What it said is kept, and the mosaic is made of the others.
    log = (run / "tiles" / "x001_y000" / "error.log").read_text()
    assert "line 0\n" in log
    assert "exit code 1" in log
    assert not (run / "tiles" / "x000_y001" / "error.log").exists()
    assert (run / "dsm.tif").read_text().split() == [name for name in read_plan(run) if name != "x001_y000"]


def test_a_tile_that_is_killed_each_time_is_a_hole_in_the_mosaic(client: Client, run: Path, satgs: str) -> None:
    write_plan(run, {"x001_y000": {"exits": [-signal.SIGKILL]}}, columns=2)
    result = run_tiles(client, run, Settings(satgs=satgs, retries=0))
    assert (result.exit_code, result.mosaic) == (3, "done")
    assert result.tiles["x001_y000"].reason == "ended by signal SIGKILL"
    failure = json.loads((run / "tiles" / "x001_y000" / "failed.json").read_text())
    assert failure == {"reason": "ended by signal SIGKILL"}
    assert json.loads((run / "mosaic" / "x000_y000.json").read_text())["tiles"] == [
        "x000_y000",
        "x000_y001",
        "x001_y001",
    ]


def test_wrong_input_is_not_tried_again(client: Client, run: Path, satgs: str) -> None:
    write_plan(run, {"x000_y000": {"exits": [2]}})
    result = run_tiles(client, run, Settings(satgs=satgs))
    assert result.exit_code == 3
    assert tile_attempts(run)["x000_y000"] == 1
    assert "input or options" in result.tiles["x000_y000"].reason


def test_a_tile_without_memory_is_tried_on_a_larger_worker_if_there_is_one(
    client: Client, run: Path, satgs: str
) -> None:
    write_plan(run, {"x000_y000": {"exits": [75, 0]}, "x001_y000": {"exits": [75]}}, memory_mb=300.0)
    result = run_tiles(client, run, Settings(satgs=satgs, retries=0))
    assert result.exit_code == 3
    assert result.tiles["x000_y000"].state == "done"
    failed = result.tiles["x001_y000"]
    # It asked for 300, 600 and 1000 MB.
    assert (failed.state, failed.attempts) == ("failed", 3)
    assert failed.reason.endswith("this machine has 8 MB; the largest worker has 1000 MB")
    events = [json.loads(line) for line in (run / "events.jsonl").read_text().splitlines()]
    workers = client.run(lambda dask_worker: dask_worker.state.total_resources["MEM"])
    later = [e["worker"] for e in events if e.get("attempt", 1) > 1 and e["event"] == "job-started"]
    assert [workers[address] for address in later] == [1000, 1000, 1000]


def test_too_little_disk_space_is_a_failure_like_others(client: Client, run: Path, satgs: str) -> None:
    write_plan(run, {"x000_y000": {"exits": [75], "lacks": "disk space"}}, columns=2)
    result = run_tiles(client, run, Settings(satgs=satgs, retries=1))
    assert result.tiles["x000_y000"].attempts == 2
    assert "MB of disk space" in result.tiles["x000_y000"].reason


def test_a_failed_blend_leaves_its_tile_done_and_the_mosaic_decides(client: Client, run: Path, satgs: str) -> None:
    write_plan(run, {"x000_y000": {"blend": 1}}, columns=2)
    result = run_tiles(client, run, Settings(satgs=satgs, retries=0))
    assert {tile.state for tile in result.tiles.values()} == {"done"}
    assert (result.mosaic, result.mosaic_is_partial, result.exit_code) == ("done", True, 3)


def test_a_reason_that_the_program_could_not_write_replaces_an_older_one(tmp_path: Path) -> None:
    path = tmp_path / "tiles" / "x000_y000" / "failed.json"
    write_failure(tmp_path, "x000_y000", "old", is_recorded=True)
    write_failure(tmp_path, "x000_y000", "of the program", is_recorded=True)
    assert json.loads(path.read_text()) == {"reason": "old"}
    write_failure(tmp_path, "x000_y000", "ended by signal SIGKILL", is_recorded=False)
    assert json.loads(path.read_text()) == {"reason": "ended by signal SIGKILL"}
    assert list(path.parent.iterdir()) == [path]


def test_records_that_cannot_be_written_are_warned_of_once(client: Client, run: Path, satgs: str) -> None:
    write_plan(run, {"x000_y000": {"exits": [-signal.SIGKILL]}}, columns=2)
    (run / "events.jsonl").mkdir()
    (run / "tiles" / "x000_y000" / "failed.json").mkdir(parents=True)
    said = io.StringIO()
    result = run_tiles(client, run, Settings(satgs=satgs, retries=0), said)
    assert (result.exit_code, result.mosaic) == (3, "done")
    assert said.getvalue().count("cannot be written") == 1


def test_an_error_of_the_client_stops_the_programs(
    client: Client, run: Path, satgs: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_plan(run, {"x002_y000": {"seconds": [100.0]}})

    def show(_self: Progress, _running: list[str]) -> None:
        if tile_attempts(run)["x002_y000"]:
            raise RuntimeError("the terminal is gone")

    monkeypatch.setattr(Progress, "show", show)
    with pytest.raises(RuntimeError, match="the terminal is gone"):
        run_tiles(client, run, Settings(satgs=satgs))
    assert_no_process_is_left(run)


def test_tiles_wait_for_a_larger_worker(run: Path, satgs: str) -> None:
    write_plan(run, memory_mb=900.0, columns=2)
    options = {"processes": False, "threads_per_worker": 1, "memory_limit": 0, "dashboard_address": ":0"}
    with (
        LocalCluster(n_workers=1, resources={"tile": 1, "MEM": 400}, **options) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):

        def add_worker() -> None:
            cluster.new_spec["options"]["resources"] = {"tile": 1, "MEM": 1000}
            cluster.scale(2)

        timer = threading.Timer(3.0, add_worker)
        timer.start()
        result = run_tiles(client, run, Settings(satgs=satgs))
        timer.join()
    assert result.exit_code == 0


def test_a_process_that_does_not_end_in_time_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(job, "STOP_SECONDS", 0.2)
    script = "import signal, time; signal.signal(15, signal.SIG_IGN); print(flush=True); time.sleep(60)"
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        job._end(process)
        assert process.returncode == -signal.SIGKILL


def test_a_tile_that_no_worker_can_hold_is_not_started(
    client: Client, run: Path, satgs: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driver, "WORKER_SECONDS", 1.0)
    write_plan(run, memory_mb=2000.0)
    result = run_tiles(client, run, Settings(satgs=satgs))
    assert result.exit_code == 1
    assert attempts(run) == []
    assert result.tiles["x000_y000"].reason == "needs 2000 MB; the largest worker has 1000 MB"


def test_selected_tiles_alone_are_made_and_the_mosaic_waits(client: Client, run: Path, satgs: str) -> None:
    write_plan(run)
    left = tuple(name for name in read_plan(run) if not name.startswith("x002"))
    result = run_tiles(client, run, Settings(satgs=satgs, only=left))
    assert (result.exit_code, result.mosaic) == (0, "waiting")
    assert set(tile_attempts(run)) == set(left)
    # Blends wait for neighbours that were not selected.
    assert {words[1] for words in attempts(run) if words[0] == "blend"} == {"x000_y000", "x000_y001"}
    with pytest.raises(PlanError, match="no tile `x009_y009`"):
        run_tiles(client, run, Settings(satgs=satgs, only=("x009_y009",)))


def test_a_program_that_is_missing_on_the_workers_is_named(client: Client, run: Path) -> None:
    write_plan(run)
    result = run_tiles(client, run, Settings(satgs="/nowhere/satgs", retries=0))
    assert result.exit_code == 1
    assert "`/nowhere/satgs` cannot be started" in result.tiles["x000_y000"].reason


def test_workers_without_the_resources_are_refused(run: Path, satgs: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(driver, "WORKER_SECONDS", 1.0)
    write_plan(run)
    with (
        LocalCluster(n_workers=1, processes=False, dashboard_address=":0") as cluster,
        Client(cluster, set_as_default=False) as client,
        pytest.raises(PlanError, match="--resources tile=1,MEM="),
    ):
        run_tiles(client, run, Settings(satgs=satgs))


def test_a_killed_worker_leaves_no_process_and_its_tile_is_made_again(client: Client, run: Path, satgs: str) -> None:
    write_plan(run, {"x002_y000": {"seconds": [100.0, 0.05]}})
    gone: list[bool] = []

    def kill_worker_of_the_tile() -> None:
        until(lambda: bool(tile_attempts(run)["x002_y000"]))
        child, worker = next(map(int, words[2:]) for words in attempts(run) if words[:2] == ["tile", "x002_y000"])
        os.kill(worker, signal.SIGKILL)
        until(lambda: not psutil.pid_exists(child), 5.0)
        gone.append(True)

    thread = threading.Thread(target=kill_worker_of_the_tile)
    thread.start()
    result = run_tiles(client, run, Settings(satgs=satgs))
    thread.join()
    assert gone, "the killed worker's program went on"
    assert result.exit_code == 0
    assert tile_attempts(run)["x002_y000"] >= 2
    assert_no_process_is_left(run)


def test_the_command_interrupted_keeps_what_is_done_and_goes_on(run: Path, satgs: str) -> None:
    slow = {"x000_y000": {"seconds": [60.0]}, "x000_y001": {"seconds": [60.0]}}
    write_plan(run, slow, columns=2)
    process = command(run, satgs, "--local", "2")
    until(lambda: {"x000_y000", "x000_y001"} <= set(tile_attempts(run)), 60.0)
    # As a terminal does it: to the client and to all its workers.
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130, out + err
    assert "the same command continues" in err
    assert_no_process_is_left(run)
    plan = read_plan(run)
    assert [name for name, tile in plan.items() if is_done(run, tile)] == ["x001_y000", "x001_y001"]

    write_plan(run, columns=2)
    process = command(run, satgs, "--local", "2")
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, out + err
    assert tile_attempts(run)["x001_y000"] == 1
    assert "tiles: 4 of 4 done" in err
    assert out.splitlines()[0].split() == ["tile", "state", "seconds", "reason"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--local", "0"], "whole number of 1 or more"),
        (["--local", "1", "--scheduler", "tcp://127.0.0.1:1"], "not allowed with"),
        (["--satgs", "no-such-program"], "there is no program `no-such-program`"),
        ([], "`satgs plan SCENE -o"),
        (["--only"], "expected at least one argument"),
    ],
)
def test_wrong_usage_is_explained(run: Path, options: list[str], said: str) -> None:
    if options:
        write_plan(run)
    process = command(run, "satgs-of-no-use", *options)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 2, err
    assert said in err


def test_a_run_after_only_is_explained(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as error:
        main(["--only", "x000_y000", "x001_y000", "run"])
    assert error.value.code == 2
    assert "RUN is missing; it stands before --only" in capsys.readouterr().err


def test_jobs_fit_when_each_has_a_worker_of_its_own() -> None:
    assert _fit([300.0, 900.0], [1000.0, 400.0])
    assert not _fit([500.0, 900.0], [1000.0, 400.0])
    assert not _fit([1.0, 1.0, 1.0], [1000.0, 400.0])
