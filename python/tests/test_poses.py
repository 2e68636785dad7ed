"""``satgs-poses``: a folder of photographs becomes a COLMAP project."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from satgs import poses


def test_what_is_no_folder_of_photographs_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pycolmap")
    for images in [tmp_path / "missing", tmp_path]:
        assert poses.main([str(images), "-o", str(tmp_path / "scene")]) == 2
        assert "hint: " in capsys.readouterr().err


def test_a_missing_pycolmap_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pycolmap", None)
    with pytest.raises(poses.PosesError, match=r"pip install './python\[poses\]'"):
        poses.find_poses(tmp_path, tmp_path / "scene")


def test_drone_photographs_become_a_scene(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("pycolmap")
    images = data / "perspective" / "brighton" / "images"
    if not images.is_dir():
        pytest.skip(f"no photographs at {images}")
    scene = tmp_path / "scene"
    assert poses.main([str(images), "-o", str(scene), "--one-camera"]) == 0
    said = capsys.readouterr().out
    assert "18 of 18 photographs have poses" in said and f"satgs run {scene} -o RUN --georef exif" in said
    assert len(list((scene / "images").iterdir())) == 18 and (scene / "sparse" / "0" / "images.bin").is_file()
    # The poses are kept, unless they are to be replaced.
    assert poses.main([str(images), "-o", str(scene)]) == 2
    assert "--overwrite" in capsys.readouterr().err
