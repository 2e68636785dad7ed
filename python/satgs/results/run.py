"""Result of all stages in a row."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from satgs.results.adjustment import Adjusted
from satgs.results.pictures import NvsScores
from satgs.results.surface import DsmSummary, Evaluation
from satgs.results.tiles import Mosaicked, Plan
from satgs.results.training import Trained


@dataclass(frozen=True)
class RunResult:
    """Result of :func:`satgs.run`. Parts that a run has not are ``None``.

    Attributes:
        adjusted: Result of the adjustment, of satellite images.
        trained: Result of the training, of a scene that is trained as a whole.
        scored: Scores of photographs that were held back.
        dsm: Result of rendering the surface model, of a scene that is trained as a whole; of photographs with a georeference.
        plan: The tiles of a scene that is larger than one tile.
        mosaic: Their mosaic.
        evaluation: Scores against the truth, if there is one.
        report: The page ``report.html``.
    """

    adjusted: Adjusted | None
    trained: Trained | None
    scored: NvsScores | None
    dsm: DsmSummary | None
    plan: Plan | None
    mosaic: Mosaicked | None
    evaluation: Evaluation | None
    report: Path | None
