"""The installed package: its name, its version, its command."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import metadata, version
from pathlib import Path

import satgs

# On PyPI the name `satgs` is that of a program for radio amateurs.
DISTRIBUTION = "satgs-photogrammetry"


def test_package_module_and_command_have_one_version() -> None:
    assert version(DISTRIBUTION) == satgs.__version__
    command = Path(sys.executable).with_name("satgs")
    printed = subprocess.run([command, "--version"], capture_output=True, text=True, check=True).stdout
    assert printed.split() == ["satgs", satgs.__version__]


def test_the_package_carries_its_licence() -> None:
    assert metadata(DISTRIBUTION)["License-Expression"] == "Apache-2.0"
