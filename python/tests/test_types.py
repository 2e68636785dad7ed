"""The type annotations: mypy accepts them strictly, and they fit what runs."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import satgs

pytest.importorskip("mypy", reason="mypy is not installed")
HERE = Path(__file__).parent


def mypy(*arguments: str, cwd: Path) -> None:
    done = subprocess.run([sys.executable, "-m", *arguments], cwd=cwd, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_mypy_accepts_a_program_that_uses_the_package(tmp_path: Path) -> None:
    mypy("mypy", "--strict", str(HERE / "typed_program.py"), cwd=tmp_path)


def test_mypy_accepts_the_package(tmp_path: Path) -> None:
    folder = Path(satgs.__file__).parent
    files = sorted(p.relative_to(folder) for p in folder.rglob("*.py") if "dask" not in p.parts)
    modules = [".".join(("satgs", *p.with_suffix("").parts)).removesuffix(".__init__") for p in files]
    mypy("mypy", "--strict", *[word for name in modules for word in ("-m", name)], cwd=tmp_path)


def test_mypy_accepts_the_driver_of_clusters(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="distributed is not installed")
    mypy("mypy", "--strict", "-p", "satgs.dask", cwd=tmp_path)


def test_the_stubs_fit_the_extension_module(tmp_path: Path) -> None:
    mypy("mypy.stubtest", "satgs._satgs", cwd=tmp_path)


def test_every_public_name_is_documented() -> None:
    for name in satgs.__all__:
        thing = getattr(satgs, name)
        if callable(thing) and name != "Event":
            assert thing.__doc__, name
