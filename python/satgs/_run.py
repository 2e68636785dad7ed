"""A run folder as an object."""

from __future__ import annotations

import html
import json
import os
import re
import tempfile
import webbrowser
from pathlib import Path
from typing import Any, TypeVar

from satgs._calls import view
from satgs._pinhole import PinholeCamera
from satgs._raster import Points, Raster
from satgs._rpc import Rpc
from satgs._splats import Splats
from satgs.errors import InputError
from satgs.results import (
    Adjusted,
    DsmSummary,
    Evaluation,
    Mosaicked,
    NvsScores,
    Plan,
    RunResult,
    Trained,
    from_json,
)

T = TypeVar("T")


class Run:
    """A run folder: what satgs made of a scene, as arrays and objects.

    Products are read at each access, so that they are those of the folder at that time.

    Attributes:
        path: The folder.
    """

    __slots__ = ("path",)

    path: Path

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Opens a run folder.

        Raises:
            InputError: There is no such folder, or it is no run.
        """
        self.path = Path(path)
        if not any((self.path / name).exists() for name in ("scene.json", "cameras.json", "tiles.json", "dsm.tif")):
            raise InputError(f"`{self.path}` is no run folder", "satgs.run(scene, run) makes one")

    @property
    def dsm(self) -> Raster:
        """The surface model: heights in metres, NaN where there is none."""
        return Raster.read(self._made("dsm.tif", "satgs.dsm(run)"))

    @property
    def ortho(self) -> Raster:
        """The orthophoto, shape (bands, rows, columns)."""
        return Raster.read(self._made("ortho.tif", "satgs.dsm(run)"))

    @property
    def confidence(self) -> Raster:
        """Opacity of the splats, standard deviation of their altitudes (m), number of views that see the cell, expected error
        (m): shape (4, rows, columns)."""
        return Raster.read(self._made("confidence.tif", "satgs.dsm(run)"))

    @property
    def error(self) -> Raster:
        """The map of errors of the surface model against the truth, metres."""
        return Raster.read(self._made("eval/error.tif", "satgs.run(scene, run, truth=…)"))

    @property
    def splats(self) -> Splats:
        """The trained splats, in metres from the origin of their site. Values are read when they are used."""
        return Splats.read(self._made("splats.ply", "satgs.train(run)"))

    @property
    def cameras(self) -> dict[str, Rpc] | dict[str, PinholeCamera]:
        """The cameras by view name: the corrected RPCs of whole satellite images, or the pinhole cameras of photographs in the
        frame of the splats."""
        folder = self.path / "ba" / "rpcs"
        if folder.is_dir():
            return {file.stem: Rpc.read(file) for file in sorted(folder.glob("*.json"))}
        content = self._json("cameras.json", "satgs.run(scene, run)")
        return {v["name"]: _pinhole(v) for v in content["views"]}

    @property
    def points(self) -> Points:
        """The adjusted tie points of satellite images."""
        return Points.read(self._made("ba/points.laz", "satgs.adjust(scene, run)"))

    @property
    def metrics(self) -> Evaluation | None:
        """Scores of the surface model against the truth; ``None`` without a truth."""
        return self._result(Evaluation, "eval/metrics.json")

    @property
    def scores(self) -> NvsScores | None:
        """Scores of photographs that were held back; ``None`` without such scores."""
        return self._result(NvsScores, "eval/nvs.json")

    @property
    def summary(self) -> RunResult:
        """The results of all stages that the folder holds, as :func:`satgs.run` returns them when all are kept."""
        colors = self._text("appearance/summary.json")
        more: dict[str, object] = {} if colors is None else {"colors": json.loads(colors)}
        mosaic = self._text("mosaic/mosaic.json")
        page = self.path / "report.html"
        return RunResult(
            adjusted=self._adjusted(),
            trained=self._result(Trained, "train/summary.json", was_complete=True, **more),
            scored=self.scores,
            dsm=self._result(DsmSummary, "dsm/summary.json", was_complete=True),
            plan=self._result(Plan, "tiles.json", was_complete=True),
            mosaic=None
            if mosaic is None
            else from_json(Mosaicked, json.dumps(json.loads(mosaic)["summary"]), was_complete=True),
            evaluation=self.metrics,
            report=page if page.is_file() else None,
        )

    def show(self, *, open_browser: bool = True) -> Path:
        """Writes the page of :func:`satgs.view` to a temporary file and opens it in the browser; returns the file.

        Raises:
            InputError: The run holds nothing to show.
        """
        page = Path(tempfile.mkdtemp(prefix="satgs-")) / f"{self.path.resolve().name}.html"
        view(self.path, page)
        if open_browser:
            webbrowser.open(page.as_uri())
        return page

    def __repr__(self) -> str:
        made = [name for name in ("dsm.tif", "splats.ply", "ba", "eval") if (self.path / name).exists()]
        return f"<satgs.Run `{self.path}`: {', '.join(made) or 'nothing is made yet'}>"

    def _repr_html_(self) -> str:
        """The head of the report, for notebooks."""
        page = self._text("report.html")
        if page is None:
            return f"<p>{html.escape(repr(self))}</p>"
        title = re.search(r"<h1>.*?</h1>", page, re.DOTALL)
        first = re.search(r'<section id="[^"]*">\n<h2>.*?(?=<section id="|</main>)', page, re.DOTALL)
        return "".join(part.group(0) for part in (title, first) if part is not None)

    def _adjusted(self) -> Adjusted | None:
        report, scene = self._text("ba/report.json"), self._text("scene.json")
        if report is None or scene is None:
            return None
        timing = json.loads(self._text("ba/summary.json") or "{}")
        # Scenes whose values are linear do not say so.
        gamma = json.loads(scene).get("transfer_function", {"gamma": 1.0})["gamma"]
        return from_json(Adjusted, report, seconds=timing.get("seconds"), gamma=gamma, was_complete=True)

    def _result(self, result: type[T], name: str, **more: object) -> T | None:
        text = self._text(name)
        return None if text is None else from_json(result, text, **more)

    def _made(self, name: str, maker: str) -> Path:
        path = self.path / name
        if not path.exists():
            raise InputError(f"`{path}` does not exist", f"{maker} makes it")
        return path

    def _json(self, name: str, maker: str) -> Any:
        return json.loads(self._made(name, maker).read_text(encoding="utf-8"))

    def _text(self, name: str) -> str | None:
        path = self.path / name
        return path.read_text(encoding="utf-8") if path.is_file() else None


def _pinhole(view: dict[str, Any]) -> PinholeCamera:
    """The camera of a view of ``cameras.json``."""
    a, b, c = map(tuple, view["cam_from_site"])
    return PinholeCamera(
        focal=tuple(view["focal"]),
        principal=tuple(view["principal"]),
        cam_from_world=(a, b, c),
        center=tuple(view["center"]),
        size=tuple(view["size"]),
    )
