"""The calls on the small scene: results, events, options, errors."""

from __future__ import annotations

import dataclasses
import os
import threading
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import pytest

import satgs
from conftest import TOWN, TRUTH
from satgs import events


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, satgs.RunResult, list[satgs.Event]]:
    run = tmp_path_factory.mktemp("whole") / "run"
    seen: list[satgs.Event] = []
    result = satgs.run(TOWN, run, iterations=60, truth=TRUTH, progress=seen.append)
    return run, result, seen


Whole = tuple[Path, satgs.RunResult, list[satgs.Event]]


def test_a_run_makes_all_products(whole: Whole) -> None:
    run, result, _ = whole
    for name in ["scene.json", "ba/report.json", "splats.ply", "dsm.tif", "ortho.tif", "confidence.tif"]:
        assert (run / name).is_file(), name
    assert result.trained is not None and result.dsm is not None and result.mosaic is None
    assert result.adjusted is not None and result.scored is None and result.plan is None
    assert result.report == run / "report.html" and (run / "report.html").is_file()
    assert result.trained.iterations == 60 and result.trained.splats > 1000
    assert len(result.adjusted.views) == 3 and result.adjusted.mean_px < result.adjusted.mean_before_px
    assert result.adjusted.left_out == ()
    assert result.dsm.grid.cell == 0.5 and "ellipsoid" in result.dsm.vertical
    cells = result.dsm.cells
    assert cells.confirmed is not None and cells.filled is not None
    assert 0.7 * cells.all < cells.with_height == cells.confirmed + cells.filled
    assert result.evaluation is not None
    scores = result.evaluation.after("xyz")
    assert scores.mae_m < 2.0 and scores.method == "xyz" and scores.completeness > 0.7
    assert scores.confirmed is not None and scores.confirmed.completeness < scores.completeness
    assert not (result.adjusted.was_complete or result.trained.was_complete or result.dsm.was_complete)
    assert "mae_m=" in repr(scores)
    with pytest.raises(dataclasses.FrozenInstanceError):
        scores.mae_m = 0.0  # type: ignore[misc]


def test_events_come_in_order_and_in_the_calling_thread(whole: Whole, run: Path) -> None:
    _, _, seen = whole
    stages = [event.stage for event in seen if isinstance(event, events.Started)]
    assert "training" in stages, stages
    begin = next(i for i, event in enumerate(seen) if isinstance(event, events.Started) and event.stage == "training")
    end = next(i for i, event in enumerate(seen) if i > begin and isinstance(event, events.Finished))
    done = [event.done for event in seen[begin:end] if isinstance(event, events.Advanced)]
    assert done == sorted(done) and done[-1] == 60
    threads = set()
    satgs.train(run, iterations=2, progress=lambda _: threads.add(threading.get_ident()))
    assert threads == {threading.get_ident()}


def test_a_callback_that_is_false_as_a_truth_value_is_called(run: Path) -> None:
    class Events(list[satgs.Event]):
        def __call__(self, event: satgs.Event) -> None:
            self.append(event)

    seen = Events()
    satgs.train(run, iterations=2, progress=seen)
    assert seen


def test_a_complete_run_is_kept(whole: Whole) -> None:
    run, result, _ = whole
    again = satgs.run(TOWN, run, iterations=60, truth=TRUTH)
    assert again.adjusted is not None and again.trained is not None and again.dsm is not None
    assert again.adjusted.was_complete and again.trained.was_complete and again.dsm.was_complete
    assert dataclasses.replace(again.trained, was_complete=False) == result.trained
    with pytest.raises(satgs.InputError, match="--seed") as caught:
        satgs.train(run, iterations=60, seed=1)
    assert caught.value.hint is not None and "--overwrite" in caught.value.hint


def test_a_lost_record_of_figures_is_told(whole: Whole) -> None:
    run, _, _ = whole
    record = run / "dsm" / "summary.json"
    before = record.read_text()
    record.unlink()
    with pytest.raises(satgs.FailedError, match="summary.json"):
        satgs.dsm(run)
    record.write_text(before)


def test_comparing_gives_the_scores_of_the_run(whole: Whole, tmp_path: Path) -> None:
    run, result, _ = whole
    scores = satgs.compare(run / "dsm.tif", TRUTH, output=tmp_path / "eval")
    assert scores.registered_scores == result.evaluation.registered_scores  # type: ignore[union-attr]
    assert (tmp_path / "eval" / "metrics.json").is_file()
    with pytest.raises(satgs.InputError, match="exists"):
        satgs.compare(run / "dsm.tif", TRUTH, output=tmp_path / "eval")
    classes = [part.name for part in scores.after("xyz").breakdown if part.by == "class"]
    assert "6 building" in classes


def test_products_can_be_added(whole: Whole) -> None:
    run, _, _ = whole
    kept = satgs.dsm(run, hillshade=True, points="cells.laz")
    assert kept.was_complete and (run / "hillshade.tif").is_file() and (run / "cells.laz").is_file()


def test_adjusting_with_fixed_cameras_measures_them(tmp_path: Path) -> None:
    fixed = satgs.adjust(TOWN, tmp_path / "run", fixed=True, height_range=(90, 220), model="shift")
    assert fixed.mean_px == pytest.approx(fixed.mean_before_px) and fixed.model == "shift"
    assert fixed.control == () and fixed.seconds is not None


def test_surveyed_points_define_the_datum(tmp_path: Path) -> None:
    controlled = satgs.adjust(TOWN, tmp_path / "run", gcps=TOWN / "truth" / "gcps.csv")
    assert controlled.control and all(point.agrees for point in controlled.control)


class Stop(Exception):
    pass


def test_an_exception_in_the_callback_stops_the_work_and_is_raised(run: Path) -> None:
    def progress(event: satgs.Event) -> None:
        if isinstance(event, events.Advanced) and event.done >= 5:
            raise Stop(event.done)

    with pytest.raises(Stop):
        satgs.train(run, iterations=100, progress=progress)
    assert (run / "train" / "checkpoint.bin").is_file() and not (run / "splats.ply").exists()
    # The folder is free again, and the same call goes on.
    notes: list[str] = []

    def listen(event: satgs.Event) -> None:
        if isinstance(event, events.Note):
            notes.append(event.text)

    assert satgs.train(run, iterations=100, progress=listen).iterations == 100
    assert any("continuing from" in note for note in notes), notes


def test_other_threads_run_while_satgs_works(run: Path) -> None:
    counted, is_done = 0, False

    def count() -> None:
        nonlocal counted
        while not is_done:
            counted += 1
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    thread.start()
    before, start = counted, time.monotonic()
    satgs.train(run, iterations=30)
    after, seconds = counted, time.monotonic() - start
    is_done = True
    thread.join()
    # A thousand a second on a free processor.
    assert after - before > 20 * seconds, f"{after - before} in {seconds} s"


def test_warnings_without_a_callback_are_warnings_of_python(tmp_path: Path) -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        satgs.adjust(TOWN, tmp_path / "run", suns={"VIEW_01": (10.0, 89.0)})
    told = [w for w in caught if w.category is satgs.SatgsWarning]
    assert told and all(w.filename == __file__ for w in told)


def test_bad_input_is_an_input_error(run: Path, tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    new = tmp_path / "new"
    wrong: list[tuple[str, Callable[[], object]]] = [
        ("nowhere", lambda: satgs.adjust(tmp_path / "nowhere", new)),
        ("empty", lambda: satgs.adjust(empty, new)),
        ("bands", lambda: satgs.adjust(TOWN, new, bands=(1, 2))),
        ("bands", lambda: satgs.adjust(TOWN, new, bands=(0,))),
        ("gamma", lambda: satgs.adjust(TOWN, new, gamma=9.0)),
        ("--stretch", lambda: satgs.adjust(TOWN, new, stretch_percent=50.0)),
        ("--sun", lambda: satgs.adjust(TOWN, new, suns={"VIEW_01": (0.0, 91.0)})),
        ("VIEW_99", lambda: satgs.adjust(TOWN, new, suns={"VIEW_99": (0.0, 45.0)})),
        ("model", lambda: satgs.adjust(TOWN, new, model="cubic")),  # type: ignore[arg-type]
        ("dem", lambda: satgs.adjust(TOWN, new, dem_sigma_m=5.0)),
        ("none.geojson", lambda: satgs.adjust(TOWN, new, aoi="none.geojson")),
        ("the area is empty", lambda: satgs.adjust(TOWN, new, aoi=(1.0, 3.0, 2.0, 2.0))),
        ("none.csv", lambda: satgs.adjust(TOWN, new, gcps=tmp_path / "none.csv")),
        ("empty", lambda: satgs.train(empty)),
        ("--iterations", lambda: satgs.train(run, iterations=0)),
        ("--checkpoint-every", lambda: satgs.train(run, checkpoint_every=0)),
        ("none.toml", lambda: satgs.train(run, recipe="none.toml")),
        ("none.onnx", lambda: satgs.train(run, recipe="satgs", features="none.onnx")),
        ("none.safetensors", lambda: satgs.train(run, recipe="satgs", lpips="none.safetensors")),
        ("checkpoint.bin", lambda: satgs.train(run, resume=True)),
        ("cameras.json", lambda: satgs.dsm(run)),
        ("--resolution", lambda: satgs.dsm(run, resolution_m=-1.0)),
        ("--resolution", lambda: satgs.run(TOWN, new, resolution_m=float("nan"))),
        ("none.tif", lambda: satgs.compare(tmp_path / "none.tif", TRUTH)),
        ("threads", lambda: satgs.set_threads(0)),
        ("`threads` is -1", lambda: satgs.set_threads(-1)),
    ]
    for message, call in wrong:
        with pytest.raises(satgs.InputError, match=message) as caught:
            call()
        assert isinstance(caught.value, satgs.SatgsError) and isinstance(caught.value, ValueError), message
    assert not new.exists()


def test_wrong_types_are_type_errors_that_name_the_argument(run: Path) -> None:
    wrong: list[tuple[str, Callable[[], object]]] = [
        ("`iterations` is 'many', expected a whole number", lambda: satgs.train(run, iterations="many")),  # type: ignore[arg-type]
        ("`run` is 7, expected a path", lambda: satgs.train(7)),  # type: ignore[arg-type]
        ("unexpected keyword argument 'iteration'", lambda: satgs.train(run, iteration=5)),  # type: ignore[call-arg]
        ("4 values, each a number", lambda: satgs.adjust(TOWN, run, aoi=(1.0, 2.0, 3.0))),  # type: ignore[arg-type]
        ("expected True or False", lambda: satgs.dsm(run, no_fill=1)),  # type: ignore[arg-type]
    ]
    for message, call in wrong:
        with pytest.raises(TypeError, match=message):
            call()
    with pytest.raises(satgs.InputError, match="`seed` is -1, expected a number from 0 on"):
        satgs.train(run, seed=-1)


def test_an_area_larger_than_a_tile_is_cut_into_tiles(tmp_path: Path) -> None:
    result = satgs.run(TOWN, tmp_path / "run", iterations=2, core_m=60.0, overlap_m=8.0, truth=TRUTH)
    assert result.mosaic is not None and result.trained is None and result.dsm is None
    assert result.mosaic.tiles >= 2 and result.mosaic.failed == () and result.mosaic.seams.seams >= 1
    assert result.evaluation is not None and (tmp_path / "run" / "dsm.tif").is_file()
    assert result.plan is not None and len(result.plan.tiles) == result.mosaic.tiles
    assert satgs.Run(tmp_path / "run").summary.mosaic is not None
    status = satgs.tile_status(tmp_path / "run")
    assert status.done == len(status.tiles) and status.failed == 0


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write everywhere")
def test_a_folder_that_cannot_be_written_is_a_failure(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(satgs.FailedError):
        satgs.adjust(TOWN, tmp_path / "run")
