"""The calls on satellite images beside the main stages: what they contain, tiles, pictures, places, cameras."""

from __future__ import annotations

from pathlib import Path

import pytest

import satgs
from conftest import TOWN, TRUTH


def test_what_a_scene_contains(tmp_path: Path) -> None:
    info = satgs.info(TOWN, footprints=tmp_path / "f.geojson", skyplot=tmp_path / "s.svg")
    assert isinstance(info, satgs.results.SatelliteInfo) and len(info.views) == 3
    assert info.views[0].name == "VIEW_01" and info.views[0].sun is not None and info.ground.common_m2 > 0
    assert len(info.convergence.pairs) == 3 and (tmp_path / "f.geojson").is_file()
    with pytest.raises(satgs.InputError, match="exists"):
        satgs.info(TOWN, skyplot=tmp_path / "s.svg")


def test_tiles_are_planned_made_and_joined_one_by_one(tmp_path: Path) -> None:
    run = tmp_path / "run"
    planned = satgs.plan(TOWN, run, core_m=60.0, overlap_m=8.0, iterations=2)
    assert planned.adjusted.tracks > 0 and len(planned.plan.tiles) >= 2 and planned.plan.train.iterations == 2
    ids = [tile.id for tile in planned.plan.tiles]
    assert satgs.tile_status(run).planned == len(ids)
    for id in ids:
        assert satgs.tile_run(run, id).splats > 0
    assert satgs.tile_run(run, ids[0]).was_complete
    for id in ids:
        assert satgs.tile_blend(run, id).id == id
    joined = satgs.mosaic(run)
    assert joined.tiles == len(ids) and not joined.failed
    assert satgs.Run(run).dsm.values.shape == (joined.grid.height, joined.grid.width)


def test_a_trained_run_is_rendered_aligned_and_exported(run: Path, tmp_path: Path) -> None:
    satgs.train(run, iterations=2)
    satgs.dsm(run)
    assert satgs.render(run, tmp_path / "a.png", view=(0.0, 20.0), size=(32, 32)).frames == 1
    assert satgs.render(run, tmp_path / "b.png", view=(0, 0), view_to=(90, 0), size=(32, 32), frames=2).frames == 2
    moved = satgs.align(run, TRUTH)
    assert not moved.was_complete and moved.alignment.points > 100 and satgs.align(run, TRUTH).was_complete
    project = satgs.export(run, colmap=tmp_path / "project")
    assert isinstance(project, satgs.results.ExportedViews) and project.views[0].distance_m is not None
    assert satgs.mesh(run, tmp_path / "mesh.glb", voxel_m=2.0).epsg is not None
    scores = satgs.nvs_eval(run, views=["VIEW_01"])
    assert scores.protocol == "half" and scores.views[0].view == "VIEW_01"
    with pytest.raises(satgs.InputError, match="--like"):
        satgs.render(run, tmp_path / "c.png")


def test_cameras_are_converted_compared_and_fitted(tmp_path: Path) -> None:
    image = TOWN / "VIEW_01.tif"
    written = satgs.rpc_convert(image, tmp_path / "camera.json")
    assert written.out == tmp_path / "camera.json" and written.to == "json" and written.source
    same = satgs.rpc_compare(image, tmp_path / "camera.json")
    assert same.max_px < 1e-6 and same.points > 0
    fit = satgs.rpc_fit(image, size_m=100.0)
    assert fit.quadratic.rms_px <= fit.affine.rms_px and fit.size_m == 100.0


def test_towns_are_simulated(tmp_path: Path) -> None:
    made = satgs.simulate(tmp_path / "town", planned=[(10, 0), (15, 180, "2024-08-20T10:30")], size_px=64, seasons=True)
    assert isinstance(made.summary, satgs.results.SimulatedScene) and len(made.summary.views) == 2
    assert made.summary.views[0].appearance is not None and made.summary.truth.is_file()
