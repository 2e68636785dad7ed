"""Runs, scenes, splats and rasters as objects."""

from __future__ import annotations

import math
import time
from pathlib import Path

import numpy as np
import pytest

import satgs
from conftest import TOWN, TRUTH


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[satgs.Run, satgs.RunResult]:
    run = tmp_path_factory.mktemp("objects") / "run"
    result = satgs.run(TOWN, run, iterations=20, truth=TRUTH)
    return satgs.Run(run), result


Made = tuple[satgs.Run, satgs.RunResult]


def test_rasters_have_values_a_place_and_a_crs(made: Made) -> None:
    run, result = made
    assert result.dsm is not None
    dsm, grid = run.dsm, result.dsm.grid
    assert dsm.values.shape == (grid.height, grid.width) and dsm.values.dtype == np.float32
    assert np.isfinite(dsm.values).sum() == result.dsm.cells.with_height
    assert dsm.transform == (grid.west, grid.cell, 0.0, grid.north, 0.0, -grid.cell) and dsm.epsg == grid.epsg
    assert dsm.x[0] == grid.west + grid.cell / 2 and dsm.y[0] == grid.north - grid.cell / 2
    assert "UTM" in dsm.crs and np.asarray(dsm) is dsm.values
    ortho = run.ortho
    assert ortho.values.shape[1:] == dsm.values.shape and ortho.values.dtype == np.uint8
    assert run.confidence.values.shape == (4, grid.height, grid.width)
    assert run.error.values.ndim == 2 and "Raster" in repr(dsm)
    with pytest.raises(satgs.InputError, match="none.tif"):
        satgs.Raster.read("none.tif")


def test_rasters_become_arrays_of_xarray(made: Made) -> None:
    pytest.importorskip("xarray", reason="xarray is not installed")
    array = made[0].dsm.to_xarray()
    assert array.dims == ("y", "x") and array.name == "dsm"
    assert float(array.x[0]) == made[0].dsm.x[0] and "UTM" in array.spatial_ref.attrs["crs_wkt"]
    assert made[0].confidence.to_xarray().dims == ("band", "y", "x")


def test_rasters_are_opened_by_rasterio(made: Made) -> None:
    pytest.importorskip("rasterio", reason="rasterio is not installed")
    with made[0].dsm.to_rasterio() as dataset:
        assert dataset.crs.to_epsg() == made[0].dsm.epsg


def test_a_run_tells_what_was_made(made: Made) -> None:
    run, result = made
    summary = run.summary
    assert summary.evaluation == result.evaluation and summary.report == result.report
    assert summary.adjusted is not None and result.adjusted is not None
    assert summary.adjusted.views == result.adjusted.views and summary.adjusted.gamma == result.adjusted.gamma
    again = satgs.run(TOWN, run.path, iterations=20, truth=TRUTH)
    assert (summary.adjusted, summary.trained, summary.dsm) == (again.adjusted, again.trained, again.dsm)
    assert set(run.cameras) == {"VIEW_01", "VIEW_02", "VIEW_03"}
    assert all(isinstance(camera, satgs.Rpc) for camera in run.cameras.values())
    points = run.points
    assert points.positions.shape == (result.adjusted.tracks, 3) and points.epsg == run.dsm.epsg
    assert points.colors.dtype == np.uint8 and points.colors.max() > 100 and len(points) > 10
    assert "dsm.tif" in repr(run) and run.scores is None
    head = run._repr_html_()
    assert "<h1>" in head and head.count("<h2>") == 1
    assert run.show(open_browser=False).stat().st_size > 100_000
    with pytest.raises(satgs.InputError, match="no run folder"):
        satgs.Run(TOWN)


def test_splats_are_views_of_the_table(made: Made, tmp_path: Path) -> None:
    run, result = made
    splats = run.splats
    assert result.trained is not None and len(splats) == result.trained.splats
    assert np.shares_memory(splats.positions, splats.table) and splats.site is not None
    assert splats.site.epsg == run.dsm.epsg and splats.f_rest is None and not splats.is_flat
    assert ((splats.opacities > 0) & (splats.opacities < 1)).all()
    assert splats.structured()["x"][5] == splats.positions[5, 0]
    before = (run.path / "splats.ply").read_bytes()
    splats.positions[:, 2] += 1.0
    splats.write(tmp_path / "up.ply")
    assert (run.path / "splats.ply").read_bytes() == before
    up = satgs.Splats.read(tmp_path / "up.ply")
    assert np.array_equal(up.positions, splats.positions) and up.site == splats.site
    run.splats.write(tmp_path / "same.ply")
    assert (tmp_path / "same.ply").read_bytes() == before
    half = splats[splats.opacities > 0.5]
    assert 0 < len(half) < len(splats) and isinstance(half, satgs.Splats)
    low, high = splats.positions.min(axis=0), splats.positions.mean(axis=0)
    inside = splats.crop(low, high)
    assert 0 < len(inside) < len(splats) and (inside.positions <= high).all()
    splats.positions[0, 0] = math.nan
    with pytest.raises(ValueError, match="position"):
        splats.write(tmp_path / "nan.ply")
    with pytest.raises(satgs.InputError, match="splat file"):
        satgs.Splats.read(TRUTH)


def test_a_camera_that_moves_with_the_splats_sees_the_same(made: Made) -> None:
    splats = made[0].splats
    middle = splats.positions.mean(axis=0)
    size = (48, 32)
    eye = middle + np.array([60.0, -80.0, 150.0])
    camera = satgs.PinholeCamera.looking_at(eye, middle, size=size, focal_px=80.0)
    assert np.allclose(camera.project(middle), [23.5, 15.5]) and camera.depth(middle) > 0
    pixel = np.array([10.0, 20.0])
    assert np.allclose(camera.project(camera.unproject(pixel, np.float64(12.0))), pixel)
    assert np.isnan(camera.project(2 * eye - middle)).all() and camera.resized(0.5).size == (24, 16)
    with pytest.raises(ValueError, match="0 x 0 pixels"):
        splats.render(camera.resized(0.001))
    seen = splats.render(camera)
    assert seen.colors.shape == (32, 48, 3) and seen.depth.shape == (32, 48) and seen.normals is None
    assert seen.opacity.mean() > 0.5 and np.nanmedian(seen.depth) > 100.0
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    moved = splats.transform(2.0, turn, (5.0, 6.0, 7.0))
    assert moved.site is None

    def place(p: object) -> object:
        return 2.0 * turn @ np.asarray(p) + np.array([5.0, 6.0, 7.0])

    other = satgs.PinholeCamera.looking_at(place(eye), place(middle), size=size, focal_px=80.0)  # type: ignore[arg-type]
    again = moved.render(other)
    assert np.abs(again.colors - seen.colors).max() < 0.02
    assert np.nanmax(np.abs(again.depth / 2 - seen.depth)) < 0.1
    for wrong in [np.diag([1.0, 1.0, -1.0]), 2 * np.eye(3), np.eye(2)]:
        with pytest.raises(ValueError, match="no rotation"):
            splats.transform(1.0, wrong)


def test_a_scene_of_satellite_images_has_views(made: Made) -> None:
    scene = satgs.Scene.read(TOWN, suns={"VIEW_01": (150.0, 50.0)})
    assert scene.kind == "satellite" and len(scene) == 3 and scene.points is None and scene.gamma is not None
    view = scene["VIEW_01"]
    assert view.sun == satgs.results.Sun(150.0, 50.0) and view.role == "train" and view.acquired is not None
    assert isinstance(view.camera, satgs.Rpc)
    image = view.image
    assert image.shape == (view.size[1], view.size[0], 3) and image.dtype == np.float32
    assert 0.0 <= np.nanmin(image) and np.nanmax(image) <= 1.0 and view.depth is None
    assert scene.height_range is not None
    corners = view.footprint(scene.height_range[0])
    assert corners is not None and corners.shape == (4, 2)
    col, row = view.camera.project(corners[:, 0], corners[:, 1], scene.height_range[0])
    assert np.allclose([col[0], row[0]], [-0.5, -0.5], atol=1.0)
    with pytest.raises(KeyError, match="VIEW_02"):
        scene["VIEW_99"]
    with pytest.raises(satgs.InputError, match="--downsampling is for perspective scenes"):
        satgs.Scene.read(TOWN, downsampling=2)


def test_a_million_splats_and_a_surface_model_open_in_50_ms(made: Made, tmp_path: Path) -> None:
    few = made[0].splats
    table = np.tile(np.asarray(few.table), (1_000_000 // len(few) + 1, 1))[:1_000_000]
    path = tmp_path / "many.ply"
    satgs.Splats(table, few.columns).write(path)
    seconds = []
    for _ in range(5):
        start = time.perf_counter()
        splats = satgs.Splats.read(path)
        splats.positions, splats.opacity_logits, splats.f_dc
        seconds.append(time.perf_counter() - start)
    assert len(splats) == 1_000_000 and min(seconds) < 0.05, seconds
    start = time.perf_counter()
    made[0].dsm
    print(f"splats {1e3 * min(seconds):.1f} ms, surface model {1e3 * (time.perf_counter() - start):.1f} ms")


def test_depth_maps_of_a_ball_become_a_mesh_of_it(tmp_path: Path) -> None:
    size, radius = (96, 72), 1.0
    eyes = [(4.0 * math.cos(a), 4.0 * math.sin(a), h) for a in np.arange(8) * math.pi / 4 for h in (-2.0, 2.0)]
    cameras = [satgs.PinholeCamera.looking_at(eye, (0.0, 0.0, 0.0), size=size, focal_px=90.0) for eye in eyes]
    pixels = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1)

    def depth(camera: satgs.PinholeCamera) -> np.ndarray:
        center = np.asarray(camera.center)
        along = camera.unproject(pixels, np.ones(pixels.shape[:2])) - center
        a, b, c = (along**2).sum(-1), along @ center, center @ center - radius**2
        inside = b**2 - a * c
        return np.where(inside > 0.0, (-b - np.sqrt(np.maximum(inside, 0.0))) / a, 0.0)

    depths = [depth(camera) for camera in cameras]
    colors = [np.broadcast_to([1.0, 0.0, 0.0], (*d.shape, 3)) for d in depths]
    mesh = satgs.fuse_depths(cameras, depths, voxel=0.05, colors=colors)
    assert mesh.triangles.shape[0] > 2000 and mesh.triangles.max() < len(mesh.vertices)
    assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - radius).mean() < 0.01
    assert mesh.colors is not None and np.median(mesh.colors, axis=0).tolist() == [255, 0, 0]
    mesh.write(tmp_path / "ball.ply")
    again = satgs.Mesh.read(tmp_path / "ball.ply")
    assert np.array_equal(again.triangles, mesh.triangles) and np.allclose(again.vertices, mesh.vertices, atol=1e-5)
    with pytest.raises(ValueError, match="16 cameras, 15 depth maps"):
        satgs.fuse_depths(cameras, depths[:15], voxel=0.05)
    with pytest.raises(satgs.InputError, match="10 x 10"):
        satgs.fuse_depths(cameras[:1], [np.ones((10, 10))], voxel=0.05)
    with pytest.raises(ValueError, match="names the vertices"):
        satgs.Mesh(mesh.vertices[:3], mesh.triangles).write(tmp_path / "no.ply")
