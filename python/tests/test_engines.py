"""The examples for SLURM, Kubernetes and dask-jobqueue, with the stand-in for the program satgs."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from stand_in import attempts, tile_attempts, write_plan, write_program

ENGINES = Path(__file__).parents[2] / "examples" / "engines"
pytestmark = [
    pytest.mark.timeout(120),
    pytest.mark.skipif(not ENGINES.is_dir(), reason="the examples are in a clone of the repository only"),
]
needs_jq = pytest.mark.skipif(shutil.which("jq") is None, reason="jq is not installed")

SBATCH = """#!/usr/bin/env bash
# Runs a job, or all jobs of an array, at once, and notes what was asked for.
set -euo pipefail
first=0 last=0 wrap=
while [ $# -gt 0 ]; do
    case "$1" in
        --array=*) range=${1#--array=}; first=${range%-*} last=${range#*-} ;;
        --cpus-per-task=*) export SLURM_CPUS_PER_TASK=${1#*=} ;;
        --wrap) wrap=$2; shift ;;
        *) options+=("$1") ;;
    esac
    shift
done
folder=$(dirname "$0")
number=$(($(wc -l <"$folder/jobs" 2>/dev/null || echo 0) + 100))
echo "$number $first-$last ${options[*]}" >>"$folder/jobs"
for ((i = first; i <= last; i++)); do
    code=0
    SLURM_ARRAY_TASK_ID=$i sh -c "$wrap" >>"$folder/output" 2>&1 || code=$?
    echo "$number $i $code" >>"$folder/codes"
done
echo "$number"
"""


@pytest.fixture
def satgs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the stand-in, which is the program satgs on the PATH."""
    folder = Path(write_program(tmp_path)).parent
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
    return folder


@needs_jq
def test_the_slurm_script_makes_all_tiles_but_those_that_fail(tmp_path: Path, satgs: Path) -> None:
    sbatch = satgs / "sbatch"
    sbatch.write_text(SBATCH)
    sbatch.chmod(sbatch.stat().st_mode | stat.S_IXUSR)
    run = tmp_path / "it's a & b\\c"
    behaviour = {"x000_y000": {"exits": [1, 0]}, "x001_y000": {"exits": [2]}, "x002_y001": {"exits": [1]}}
    write_plan(run, {**behaviour, "x002_y000": {"exits": [-9]}})

    def submit() -> str:
        command = [ENGINES / "slurm.sh", run, "--partition=short"]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout

    assert "tiles: job 100, blending: job 101, mosaic: job 102" in submit()
    jobs = [line.split(maxsplit=2) for line in (satgs / "jobs").read_text().splitlines()]
    assert [job[1] for job in jobs] == ["0-5", "0-5", "0-0"]
    assert "--mem=120M" in jobs[0][2]
    assert all("--partition=short" in job[2] for job in jobs)
    assert "--dependency=afterany:100" in jobs[1][2]
    assert "--dependency=afterany:101" in jobs[2][2]
    # Exit code 1 and a signal are tried three times, 2 once.
    counts = tile_attempts(run)
    assert [counts[f"x{x:03}_y{y:03}"] for y in range(2) for x in range(3)] == [2, 1, 3, 1, 1, 3]
    assert (run / "dsm.tif").read_text().split() == ["x000_y000", "x000_y001", "x001_y001"]
    assert (satgs / "codes").read_text().splitlines()[-1] == "102 0 3"

    # The same command tries again what failed.
    (run / "behaviour.json").write_text("{}")
    submit()
    assert len((run / "dsm.tif").read_text().split()) == 6
    assert (satgs / "codes").read_text().splitlines()[-1] == "105 0 0"


def read_job(name: str) -> dict[str, Any]:
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
    (job,) = yaml.safe_load_all((ENGINES / name).read_text())
    assert (job["apiVersion"], job["kind"]) == ("batch/v1", "Job")
    pod = job["spec"]["template"]["spec"]
    assert pod["restartPolicy"] == "Never"  # A pod failure policy requires it.
    (container,) = pod["containers"]
    assert {"name", "image", "command", "resources"} <= container.keys()
    mounted = {mount["name"] for mount in container["volumeMounts"]}
    assert mounted == {volume["name"] for volume in pod["volumes"]}
    for rule in job["spec"]["podFailurePolicy"]["rules"]:
        assert ("onExitCodes" in rule) != ("onPodConditions" in rule)
        if "onExitCodes" in rule:
            assert rule["onExitCodes"]["containerName"] == container["name"]
            assert rule["onExitCodes"]["operator"] == "In"
            assert 0 not in rule["onExitCodes"]["values"]
    return dict(job)


def call(job: dict[str, Any], run: Path, **environment: str) -> int:
    """Runs the command of a job's container, with the run's path in place of that in the container."""
    (container,) = job["spec"]["template"]["spec"]["containers"]
    command = [word.replace("/data/run", str(run)) for word in (*container["command"], *container.get("args", []))]
    return subprocess.run(command, env={**os.environ, **environment}, check=False).returncode


def test_the_kubernetes_job_makes_one_tile_for_each_index(tmp_path: Path, satgs: Path) -> None:
    job = read_job("kubernetes-tiles.yaml")
    spec = job["spec"]
    assert spec["completionMode"] == "Indexed"
    assert spec["backoffLimitPerIndex"] == 2
    assert 1 <= spec["parallelism"] <= spec["completions"]
    rules = {rule["action"]: rule for rule in spec["podFailurePolicy"]["rules"]}
    assert rules["FailIndex"]["onExitCodes"]["values"] == [2, 75]
    assert rules["Ignore"]["onPodConditions"] == [{"type": "DisruptionTarget"}]
    write_plan(tmp_path / "run", {"x001_y001": {"exits": [2]}}, columns=2)
    assert spec["completions"] == 4
    codes = [call(job, tmp_path / "run", JOB_COMPLETION_INDEX=str(i)) for i in range(4)]
    assert codes == [0, 0, 0, 2]


def test_the_kubernetes_job_of_the_mosaic_leaves_failed_tiles_out(tmp_path: Path, satgs: Path) -> None:
    tiles, mosaic = read_job("kubernetes-tiles.yaml"), read_job("kubernetes-mosaic.yaml")
    assert "completionMode" not in mosaic["spec"]
    run = tmp_path / "run"
    write_plan(run, {"x001_y001": {"exits": [2]}, "x000_y001": {"exits": [-9, 0]}}, columns=2)
    for i in range(4):
        call(tiles, run, JOB_COMPLETION_INDEX=str(i))
    assert call(mosaic, run) == 3
    assert (run / "dsm.tif").read_text().split() == ["x000_y000", "x001_y000"]
    (run / "behaviour.json").write_text("{}")
    for i in range(4):
        call(tiles, run, JOB_COMPLETION_INDEX=str(i))
    assert call(mosaic, run) == 0
    assert {words[1] for words in attempts(run) if words[0] == "blend"} == set(tile_attempts(run))


def load_example(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ENGINES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_dask_jobqueue_example_asks_for_workers_that_make_one_tile_at_a_time(tmp_path: Path) -> None:
    jobqueue = pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed")
    example = load_example("dask_on_slurm")
    write_plan(tmp_path / "run", memory_mb=1000.0)
    with jobqueue.SLURMCluster(**example.options(tmp_path / "run", "short")) as cluster:
        script = cluster.job_script()
    assert "#SBATCH -p short" in script
    assert "#SBATCH --cpus-per-task=2" in script
    # Of an option that is given twice the last one counts.
    assert script.rindex("--nthreads 1 --resources tile=1,MEM=1200") > script.index("--nthreads 2")


def test_the_dask_jobqueue_example_makes_the_tiles(
    tmp_path: Path, satgs: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed")
    from distributed import LocalCluster

    class Cluster(LocalCluster):  # type: ignore[misc]
        """Starts the workers that it is asked for on this machine."""

        def __init__(self, worker_extra_args: list[str], **_options: Any):
            pairs = [pair.split("=") for pair in worker_extra_args[-1].split(",")]
            resources = {name: float(value) for name, value in pairs}
            super().__init__(n_workers=0, threads_per_worker=1, resources=resources, dashboard_address=":0")

        def scale(self, jobs: int) -> Any:
            return super().scale(n=jobs)

    example = load_example("dask_on_slurm")
    monkeypatch.setattr(example, "SLURMCluster", Cluster)
    write_plan(tmp_path / "run", {"x000_y000": {"exits": [2]}}, columns=2)
    assert example.main([str(tmp_path / "run"), "2"]) == 3
    assert capsys.readouterr().out.splitlines()[1] == "x001_y000 done "


def test_more_workers_are_simulated_from_the_times_of_the_tiles(tmp_path: Path) -> None:
    run = tmp_path / "run"
    write_plan(run)
    for n, name in enumerate(("x000_y000", "x001_y000")):
        folder = run / "tiles" / name
        folder.mkdir(parents=True)
        (folder / "done.json").write_text(json.dumps({"input_hash": "", "seconds": 3600.0 * (n + 1)}))
    script = ENGINES.parents[1] / "scripts" / "simulate-workers"
    said = subprocess.run([sys.executable, script, run, "--tiles", "400"], check=True, capture_output=True, text=True)
    lines = [line.strip("| ").split(" | ") for line in said.stdout.splitlines()]
    assert lines[0] == ["6 tiles, 2 of them measured, the others as predicted"]
    one, two = lines[5], lines[6]
    assert (one[0], one[2], two[0], two[2]) == ("1", "1.0", "2", "2.0")
    assert float(one[1]) == pytest.approx(2.0 * float(two[1]), rel=0.01)
