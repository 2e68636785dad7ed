"""The plugin in QGIS without its window: its algorithms are there, run the program and say where the results are."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = ROOT / "target" / "debug" / "satgs"
# Debian's script of that name calls it with an option that it does not know.
QGIS = shutil.which("qgis_process.bin") or shutil.which("qgis_process")

pytestmark = pytest.mark.skipif(
    QGIS is None or not PROGRAM.exists(), reason="QGIS is not installed, or satgs is not built"
)


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("home", numbered=True)
    folder.chmod(0o700)
    assert called(folder, "plugins", "enable", "satgs_qgis").returncode == 0
    return folder


def called(home: Path, *words: str) -> subprocess.CompletedProcess[str]:
    environment = {
        **os.environ,
        "HOME": str(home),
        "XDG_RUNTIME_DIR": str(home),
        "QT_QPA_PLATFORM": "offscreen",
        "QGIS_PLUGINPATH": str(ROOT / "qgis"),
        "PATH": f"{PROGRAM.parent}{os.pathsep}{os.environ['PATH']}",
    }
    return subprocess.run([str(QGIS), *words], capture_output=True, text=True, env=environment, timeout=300)


def test_all_algorithms_are_listed_with_the_help_of_the_program(home: Path) -> None:
    listed = called(home, "list").stdout
    for name in ["ba", "run", "dsm-eval", "changes", "align", "export"]:
        assert f"satgs:{name}" in listed, listed
    described = called(home, "help", "satgs:run").stdout
    assert "Also write the bare ground" in described, described


def test_a_surface_is_compared_with_a_truth(home: Path, tmp_path: Path) -> None:
    truth = ROOT / "data" / "town" / "truth" / "TOWN_DSM.tif"
    made = called(home, "run", "satgs:dsm-eval", "--", f"dsm={truth}", f"truth={truth}", f"output={tmp_path / 'score'}")
    assert made.returncode == 0, made.stdout + made.stderr
    scores = json.loads((tmp_path / "score" / "metrics.json").read_text())
    assert scores["prediction"].endswith("TOWN_DSM.tif")
    assert (tmp_path / "score" / "error.tif").exists() and (tmp_path / "score" / "error.qml").exists()


def test_the_error_of_the_program_is_that_of_the_algorithm(home: Path, tmp_path: Path) -> None:
    made = called(home, "run", "satgs:ba", "--", f"scene={tmp_path / 'absent'}", f"output={tmp_path / 'run'}")
    assert made.returncode != 0
    assert "absent" in made.stdout + made.stderr
