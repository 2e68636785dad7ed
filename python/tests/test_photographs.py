"""The calls and objects on photographs: a simulated room."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import satgs
from satgs import events

ITERATIONS = 3


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("photographs") / "room"
    made = satgs.simulate(folder, room=True, views=8, size_px=64)
    assert isinstance(made.summary, satgs.results.SimulatedPhotographs) and len(made.summary.views) == 8
    assert made.options["size_px"] == 64 and made.out == folder
    return folder


@pytest.fixture(scope="module")
def trained(room: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, satgs.RunResult]:
    run = tmp_path_factory.mktemp("room") / "run"
    return run, satgs.run(room, run, iterations=ITERATIONS, test_views=4)


Trained = tuple[Path, satgs.RunResult]


def test_what_a_scene_contains(room: Path) -> None:
    info = satgs.info(room)
    assert isinstance(info, satgs.results.PhotographsInfo)
    assert info.layout == "colmap" and info.train + info.test == 8 and info.cameras[0].views == 8
    scene = satgs.Scene.read(room, downsampling=2, test_views="none")
    assert scene.kind == "COLMAP project" or scene.kind
    view = scene.views[0]
    assert isinstance(view.camera, satgs.PinholeCamera) and view.size == (32, 32) == view.camera.size
    assert view.image.shape == (32, 32, 3) and view.sun is None and {v.role for v in scene.views} == {"train"}
    assert scene.points is not None and len(scene.points) == info.points
    seen = view.camera.project(scene.points.positions)
    assert np.isfinite(seen).all(axis=1).any()
    with pytest.raises(satgs.InputError, match="--aoi is for satellite scenes"):
        satgs.info(room, aoi=(1.0, 2.0, 3.0, 4.0))


def test_photographs_are_trained_and_scored(trained: Trained) -> None:
    run, result = trained
    assert result.adjusted is None and result.dsm is None and result.trained is not None
    assert result.trained.iterations == ITERATIONS and result.trained.camera_rms_px is None
    assert result.scored is not None and len(result.scored.views) == 2 and result.scored.mean is not None
    opened = satgs.Run(run)
    assert opened.scores is not None and opened.scores.mean == result.scored.mean
    assert opened.summary.trained == satgs.train(run, iterations=ITERATIONS)
    scores = satgs.nvs_eval(run)
    assert scores.mean is not None and scores.mean.psnr_db == pytest.approx(result.scored.mean.psnr_db)


def test_a_view_is_rendered_alike_by_the_call_and_from_the_splats(trained: Trained, tmp_path: Path) -> None:
    run, _ = trained
    opened = satgs.Run(run)
    cameras = opened.cameras
    name, camera = next(iter(cameras.items()))
    assert isinstance(camera, satgs.PinholeCamera) and len(cameras) == 8
    rendered = satgs.render(run, tmp_path / "view.tif", like=name)
    assert rendered.frames == 1
    written = satgs.Raster.read(rendered.output)
    seen = opened.splats.render(camera, nearest=0.01)
    assert written.values.shape == (4, 64, 64)
    assert np.abs(written.values[:3].transpose(1, 2, 0) - seen.colors).max() < 0.1


def test_meshes_of_depths_are_scored(room: Path, tmp_path: Path) -> None:
    mesh = satgs.simulate(tmp_path / "air", aerial=True, views=4, size_px=64).summary
    assert isinstance(mesh, satgs.results.SimulatedPhotographs)
    scores = satgs.mesh_eval(mesh.mesh, mesh.mesh, threshold_m=5.0, error_mesh=tmp_path / "error.ply")
    assert scores.f1 > 0.99 and (tmp_path / "error.ply").is_file() and scores.alignment is None


def test_a_trained_run_becomes_a_mesh_a_project_and_a_page(trained: Trained, tmp_path: Path) -> None:
    run, _ = trained
    made = satgs.mesh(run, tmp_path / "mesh.ply", voxel_m=0.05)
    assert made.output.is_file() and made.triangles > 0
    project = satgs.export(run, colmap=tmp_path / "project", format="text")
    assert isinstance(project, satgs.results.ExportedViews) and len(project.views) == 8
    ply = satgs.export(run, ply=tmp_path / "splats.ply")
    assert isinstance(ply, satgs.results.ExportedSplats) and ply.splats == len(satgs.Splats.read(ply.file))
    page = satgs.view(run, tmp_path / "page.html")
    assert page.bytes == page.page.stat().st_size and "splats" in " ".join(page.layers).lower()
    assert satgs.report(run) == run / "report.html"


def test_maps_of_priors_are_made_and_kept(room: Path, tmp_path: Path) -> None:
    made = satgs.prior(room, tmp_path / "depths", stereo=True, test_views="none")
    assert made.made + made.left_out == 8
    again = satgs.prior(room, tmp_path / "depths", stereo=True, test_views="none")
    assert again.made == 0 and again.kept == made.made


def test_splats_are_predicted_in_one_pass(room: Path, tmp_path: Path) -> None:
    predicted = satgs.predict(room, tmp_path / "fast", without_network="isotropic")
    assert predicted.splats > 100 and not predicted.was_complete
    assert satgs.predict(room, tmp_path / "fast", without_network="isotropic").was_complete
    assert len(satgs.Run(tmp_path / "fast").splats) == predicted.splats


def test_the_model_of_predictions_is_written(tmp_path: Path) -> None:
    written = satgs.learn(tmp_path / "model.safetensors", start="built-in")
    assert isinstance(written, satgs.results.WrittenModel) and written.network.width > 0
    assert (tmp_path / "model.safetensors").is_file()


def test_an_interrupted_training_of_photographs_goes_on(room: Path, tmp_path: Path) -> None:
    class Stop(Exception):
        pass

    def progress(event: satgs.Event) -> None:
        if isinstance(event, events.Advanced) and event.status.startswith("loss"):
            raise Stop

    run = tmp_path / "run"
    with pytest.raises(Stop):
        satgs.run(room, run, iterations=40, progress=progress)
    assert (run / "train" / "checkpoint.bin").is_file() and not (run / "splats.ply").exists()
    notes: list[str] = []

    def listen(event: satgs.Event) -> None:
        if isinstance(event, events.Note):
            notes.append(event.text)
        if isinstance(event, events.Advanced) and event.status.startswith("loss"):
            raise Stop

    with pytest.raises(Stop):
        satgs.run(room, run, iterations=40, progress=listen)
    assert any("continuing from" in note for note in notes), notes


def test_progress_bars_of_tqdm(room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("tqdm", reason="tqdm is not installed")
    satgs.predict(room, tmp_path / "fast", without_network="isotropic", progress=True)
    said = capsys.readouterr()
    assert "%" in said.err or "it" in said.err
