"""What several test files need: the small scene, the folder of real data, a run to copy."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

import satgs
from satgs.results import _json

ROOT = Path(__file__).resolve().parents[2]
TOWN = ROOT / "data" / "town"
TRUTH = TOWN / "truth" / "TOWN_DSM.tif"


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real data: `SATGS_DATA`, else `../shared/data`."""
    folder = Path(os.environ.get("SATGS_DATA", ROOT / ".." / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real data at {folder} (SATGS_DATA names another place)")
    return folder


@pytest.fixture(scope="session", autouse=True)
def unknown_keys_are_errors() -> None:
    """What a command prints has a field in the result."""

    def refuse(kind: type, keys: set[str]) -> None:
        assert not keys, f"{kind.__name__} has no field for {sorted(keys)}"

    _json.report_unknown = refuse


@pytest.fixture(scope="session")
def adjusted_town(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("town") / "run"
    satgs.adjust(TOWN, run)
    return run


@pytest.fixture
def run(adjusted_town: Path, tmp_path: Path) -> Path:
    """An adjusted run of its own."""
    return Path(shutil.copytree(adjusted_town, tmp_path / "run"))
