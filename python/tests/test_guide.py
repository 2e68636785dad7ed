"""The programs of the guide's page, run in order as a reader would run them."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from conftest import ROOT


def test_programs_of_the_guide_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(ROOT / "data", tmp_path / "data")
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "docs" / "guide" / "python.md").read_text()
    programs = re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    assert len(programs) >= 5
    names: dict[str, object] = {}
    for program in programs:
        exec(compile(program, "docs/guide/python.md", "exec"), names)
