"""Every command has a call, every option of a command an argument of its call, and both take the same values."""

from __future__ import annotations

import inspect
import re
import types
import typing
from pathlib import Path
from typing import Any, Literal

import pytest

import satgs
from conftest import ROOT
from satgs import _calls
from satgs._command_words import CALLS, described_arguments, option_of, words_of

NO_CALL = {
    "rpc project": "`Rpc.project` takes arrays",
    "rpc localize": "`Rpc.localize` takes arrays",
}
NO_ARGUMENT = {
    ("train", "print-recipe"): "it prints a template",
    ("learn", "print-config"): "it prints a template",
    ("info", "devices"): "it takes no scene",
    ("tile run", "index"): "it is for job arrays of clusters, which give numbers",
    ("tile blend", "index"): "it is for job arrays of clusters, which give numbers",
    ("view", "live"): "a call writes the page to a file",
    ("view", "port"): "a call writes the page to a file",
    ("view", "no-open"): "a call opens no browser",
}
OF_JOBS = {"exit-with-parent"}
"""Options of commands that other programs supervise."""


def command_options() -> list[tuple[str, str]]:
    return [(command, name) for command, known in described_arguments().items() for name in known]


def test_every_command_has_a_call() -> None:
    without = set(described_arguments()) - {call.command for call in CALLS.values()}
    assert without == set(NO_CALL)
    public = {n for n, f in vars(_calls).items() if inspect.isfunction(f) and f.__module__ == _calls.__name__ and n[0] != "_"}
    assert set(CALLS) | {"set_threads"} == public
    assert set(CALLS) <= set(satgs.__all__)


def test_every_option_is_an_argument_and_every_argument_an_option() -> None:
    of_calls = {(c.command, option_of(c.command, k)) for c in CALLS.values() for k in c.kinds if k != "progress"}
    of_commands = {(c, name) for c, name in command_options() if name not in OF_JOBS and c not in NO_CALL}
    assert of_commands - of_calls == set(NO_ARGUMENT)
    assert of_calls - of_commands == set()


def literals(kind: Any) -> set[str]:
    if typing.get_origin(kind) is Literal:
        return set(typing.get_args(kind))
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        return set().union(*map(literals, typing.get_args(kind)))
    return set()


def test_arguments_have_the_types_and_values_of_their_options() -> None:
    for name, call in CALLS.items():
        for keyword, kind in call.kinds.items():
            if keyword == "progress":
                continue
            option = described_arguments()[call.command][option_of(call.command, keyword)]
            assert option["takes_value"] or option["is_position"] or kind == (bool | None), (name, keyword)
            assert not option["is_required"] or types.NoneType not in typing.get_args(kind), (name, keyword)
            values = set(option["values"])
            if literals(kind) and values:
                assert literals(kind) == values, (name, keyword)


def test_arguments_become_words_of_the_command() -> None:
    words = words_of(
        "ba",
        {
            "scene": "-odd name",
            "run": Path("run"),
            "suns": {"a=b": (150.0, 1e-7)},
            "bands": [3, 2, 1],
            "reference_views": ["a", "b"],
            "trust_rpc": True,
            "fixed": False,
            "gamma": None,
            "stretch_percent": 0.1,
        },
    )
    expected = ["--output=run", "--sun=a=b=150.0,1e-07", "--bands=3,2,1", "--reference=a", "--reference=b"]
    assert words == ["ba", *expected, "--trust-rpc", "--stretch=0.1", "--", "-odd name"]
    assert words_of("plan", {"max_memory_mb": 3000})[1] == "--max-memory=3000MB"
    planned = words_of("simulate", {"out": "o", "planned": [(11, 191.5, "2024-08-20T10:30"), (1, 2)]})
    assert planned == ["simulate", "--view=11,191.5,2024-08-20T10:30", "--view=1,2", "--", "o"]


@pytest.mark.parametrize("name", sorted(CALLS))
def test_calls_document_their_arguments(name: str) -> None:
    function = getattr(satgs, name)
    assert "**options" not in function.__doc__
    for keyword, parameter in inspect.signature(function).parameters.items():
        entry = re.search(rf"^        {keyword}: (.+)", function.__doc__, re.MULTILINE)
        assert entry is not None, (name, keyword)
        assert (parameter.kind is parameter.KEYWORD_ONLY) == (parameter.default is None), (name, keyword)


def test_the_guide_has_a_row_for_every_command() -> None:
    guide = (ROOT / "docs" / "guide" / "python.md").read_text()
    rows = [line for line in guide.splitlines() if line.startswith("| `satgs")]
    for command in described_arguments():
        assert any(f"`satgs {command} " in row or f"`satgs {command}`" in row for row in rows), command
    for name in CALLS:
        assert any(f"`satgs.{name}(" in row for row in rows), name
