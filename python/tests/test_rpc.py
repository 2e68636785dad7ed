"""`satgs.Rpc` against values computed elsewhere, and as a citizen of Python."""

from __future__ import annotations

import json
import pickle
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import satgs
from conftest import TOWN

# As in tests/it/rpc_oracles.rs: projections in pixels, localisations in degrees (a micrometre on the ground).
PX = 1e-6
DEG = 1e-11


def column(cases: list[dict[str, float]], key: str) -> np.ndarray:
    return np.array([case[key] for case in cases])


def test_files_agree_with_the_oracles(data: Path) -> None:
    oracles = json.loads((data / "rpc" / "oracles.json").read_text())
    assert len(oracles) == 25
    for name, oracle in oracles.items():
        # Two crops of SkySat images are smaller than their RPC says; the oracle takes it as it is.
        rpc = satgs.Rpc.read(data / name, trust_rpc=True)
        cases = oracle["localise"] + oracle["project"]
        col, row = rpc.project(column(cases, "lon"), column(cases, "lat"), column(cases, "alt"))
        assert np.hypot(col - column(cases, "col"), row - column(cases, "row")).max() < PX, name
        cases = [case for case in cases if "target_col" in case]
        lon, lat = rpc.localize(column(cases, "target_col"), column(cases, "target_row"), column(cases, "alt"))
        assert np.abs([lon - column(cases, "lon"), lat - column(cases, "lat")]).max() < DEG, name


@pytest.fixture(scope="module")
def rpc() -> satgs.Rpc:
    return satgs.Rpc.read(TOWN / "truth" / "rpcs" / "VIEW_01.json")


def test_arguments_are_broadcast(rpc: satgs.Rpc) -> None:
    lon, lat, h = rpc.ground_offset
    lons = lon + np.linspace(-1e-4, 1e-4, 5)
    lats = lat + np.linspace(-1e-4, 1e-4, 3)[:, np.newaxis]
    col, row = rpc.project(lons, lats, h)
    assert col.shape == row.shape == (3, 5) and col.dtype == np.float64
    one_col, one_row = rpc.project(lons[4], lats[2, 0], h)
    assert one_col.shape == () and abs(float(one_col) - col[2, 4]) < 1e-9 and abs(float(one_row) - row[2, 4]) < 1e-9
    # Other types, orders and strides of the same numbers.
    turned, _ = rpc.project(np.asfortranarray(np.broadcast_to(lons, (3, 5))), lats.tolist(), int(h))
    assert np.array_equal(turned, col)
    packed = np.zeros(5, dtype=[("a", "u1"), ("b", "<f8")])
    packed["b"] = lons
    unaligned, _ = rpc.project(packed["b"], lats, h)
    assert np.array_equal(unaligned, col)
    strided, _ = rpc.project(np.repeat(lons, 2)[::2], lats, h)
    assert np.array_equal(strided, col)
    assert rpc.project([], [], [])[0].shape == (0,)


def test_localisation_inverts_projection(rpc: satgs.Rpc) -> None:
    cols, rows = np.meshgrid(np.arange(0.0, 400.0, 40.0), np.arange(0.0, 400.0, 40.0))
    low, high = rpc.height_range
    h = np.linspace(low, high, cols.size).reshape(cols.shape)
    col, row = rpc.project(*rpc.localize(cols, rows, h), h)
    assert np.abs([col - cols, row - rows]).max() < 1e-7


def test_a_point_without_an_image_is_nan(rpc: satgs.Rpc) -> None:
    lon, lat = rpc.localize([10.0, 1e9, np.nan], 10.0, rpc.ground_offset[2])
    assert np.isnan(lon).tolist() == np.isnan(lat).tolist() == [False, True, True]


def test_shapes_that_do_not_fit_are_an_error(rpc: satgs.Rpc) -> None:
    with pytest.raises(ValueError):
        rpc.project(np.zeros(3), np.zeros(4), 0.0)


def test_coefficients_are_arrays_that_give_the_projection(rpc: satgs.Rpc) -> None:
    assert rpc.col_num.shape == rpc.col_den.shape == rpc.row_num.shape == rpc.row_den.shape == (20,)
    assert rpc.image_scale.shape == (2,) and rpc.ground_scale.shape == (3,)
    # At the centre only the constant terms count.
    col, row = rpc.project(*rpc.ground_offset)
    assert abs(col - (rpc.image_offset[0] + rpc.image_scale[0] * rpc.col_num[0] / rpc.col_den[0])) < 1e-9
    assert abs(row - (rpc.image_offset[1] + rpc.image_scale[1] * rpc.row_num[0] / rpc.row_den[0])) < 1e-9


def test_a_camera_survives_pickle_and_json(rpc: satgs.Rpc) -> None:
    again = pickle.loads(pickle.dumps(rpc))
    assert again == rpc == satgs.Rpc(rpc.to_json())
    other = satgs.Rpc.read(TOWN / "truth" / "rpcs" / "VIEW_02.json")
    assert other != rpc
    assert "satgs.Rpc" in repr(rpc) and rpc.format == "rpcm JSON" and rpc.warnings == ()


def test_what_is_not_an_rpc_is_an_input_error(tmp_path: Path) -> None:
    missing = tmp_path / "none.txt"
    with pytest.raises(satgs.InputError, match="none.txt") as caught:
        satgs.Rpc.read(missing)
    assert isinstance(caught.value, ValueError) and caught.value.hint
    with pytest.raises(satgs.InputError, match="not an RPC file"):
        satgs.Rpc("Call me Ishmael.")
    again = pickle.loads(pickle.dumps(caught.value))
    assert (again.message, again.hint, str(again)) == (caught.value.message, caught.value.hint, str(caught.value))


def test_projection_is_10_times_as_fast_as_rpcm(rpc: satgs.Rpc, capsys: pytest.CaptureFixture[str]) -> None:
    rpcm = pytest.importorskip("rpcm", reason="rpcm is not installed")
    camera = json.loads(rpc.to_json())["rpc"]
    theirs = rpcm.RPCModel(camera, dict_format="rpcm")
    n = 200_000
    places = np.random.default_rng(0).uniform(-1.0, 1.0, (3, n))
    lon, lat, h = rpc.ground_offset[:, np.newaxis] + places * rpc.ground_scale[:, np.newaxis]

    def seconds(project: Callable[..., object]) -> float:
        # Both work in one thread; other programs on the machine do not count.
        times = []
        for _ in range(5):
            start = time.process_time()
            project(lon, lat, h)
            times.append(time.process_time() - start)
        return min(times)

    # By turns, as the clock of a shared machine changes, several calls in each: the first one finds in the caches what the other
    # program has left there. Processors with 512-bit registers help NumPy as much as satgs.
    pairs = [(seconds(rpc.project), seconds(theirs.projection)) for _ in range(8)]
    ours_s, theirs_s = np.min(pairs, axis=0)
    assert np.abs(np.array(rpc.project(lon, lat, h)) - np.array(theirs.projection(lon, lat, h))).max() < PX
    with capsys.disabled():
        print(f"\n{n} points: satgs {n / ours_s / 1e6:.1f}, rpcm {n / theirs_s / 1e6:.2f} million a second, {theirs_s / ours_s:.0f} times")
    assert theirs_s / ours_s >= 10
