"""Calls of commands: keyword arguments become the words of a command line, which the extension module runs.

The command line is the one place where arguments are read, checked and given defaults. What follows from it (which words are
positions, which repeat, which take no value) comes from its own description, `_satgs.arguments()`.
"""

from __future__ import annotations

import functools
import inspect
import json
import numbers
import os
import sys
import typing
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from satgs import _satgs, events, options
from satgs._arguments import check
from satgs.errors import SatgsWarning
from satgs.events import Event, Progress, ProgressBars

F = TypeVar("F", bound=Callable[..., Any])
Figures = tuple[str, str | None, bool]
"""Name of a stage; its figures as JSON, none if their record has gone; whether it was complete before."""

UNITS = ("_m", "_m2", "_mb", "_px", "_percent")
"""Endings that keyword arguments have and options have not."""

RENAMED: dict[tuple[str, str], str] = {
    # A scene is read, a folder is written.
    ("ba", "run"): "output",
    ("run", "run"): "output",
    ("plan", "run"): "output",
    ("mesh", "source"): "input",
    # An option that is repeated is one argument with several values.
    ("*", "suns"): "sun",
    ("*", "reference_views"): "reference",
    ("nvs-eval", "views"): "view",
    ("simulate", "planned"): "view",
    # Codes are EPSG codes, `from` is a word of Python, and no name begins with a digit.
    ("*", "truth_epsg"): "truth-crs",
    ("align", "epsg"): "crs",
    ("export", "tiles3d"): "3dtiles",
    ("learn", "start"): "from",
}
"""Option or position of a keyword argument of a command (`*`: of all), where it is not that of the same name."""


@dataclass(frozen=True)
class Call:
    """A call: its command, and the types of its arguments."""

    command: str
    kinds: Mapping[str, Any]


CALLS: dict[str, Call] = {}
"""The calls by name."""


class _Anything:
    def __class_getitem__(cls, _: object) -> object:
        return object


def calls(command: str, of_options: Any) -> Callable[[F], F]:
    """Makes a function the call of a command with the options of a dictionary type: they are its keywords for `help`, for
    editors and for checks."""

    def described(function: F) -> F:
        own = inspect.signature(function)
        hints = typing.get_type_hints(function, localns={"Unpack": _Anything})
        positions = [p for p in own.parameters.values() if p.kind is not p.VAR_KEYWORD]
        keywords = typing.get_type_hints(of_options)
        CALLS[function.__name__] = Call(command, {p.name: hints[p.name] for p in positions} | keywords)
        kind = inspect.Parameter.KEYWORD_ONLY
        named = [inspect.Parameter(name, kind, default=None, annotation=hint) for name, hint in keywords.items()]
        setattr(function, "__signature__", own.replace(parameters=[*positions, *named]))
        lines = (function.__doc__ or "").split("\n")
        place = next((i for i, line in enumerate(lines) if line.strip().startswith("**options:")), None)
        if place is not None:
            lines[place : place + 1] = [f"        {name}: {_documentation(of_options, name)}" for name in keywords]
            function.__doc__ = "\n".join(lines)
        return function

    return described


def run_command(call: str, arguments: Mapping[str, object]) -> list[Figures]:
    """Runs the command of a call; the figures of all its stages.

    Raises:
        TypeError: An argument is unknown or of a wrong type.
        SatgsError: The command is not complete.
    """
    check(call, CALLS[call].kinds, arguments)
    return _satgs.call(words_of(CALLS[call].command, arguments), listener(arguments.get("progress")))


def words_of(command: str, arguments: Mapping[str, object]) -> list[str]:
    """The words of a command line."""
    known = described_arguments()[command]
    words, positions = command.split(), []
    for keyword, value in arguments.items():
        if value is None or keyword == "progress":
            continue
        name = option_of(command, keyword)
        option = known[name]
        if option["is_position"]:
            # Positions stand in the order of the call, which is that of the command.
            positions.append(_word(value))
        elif not option["takes_value"]:
            words += [f"--{name}"] if value else []
        else:
            unit = "MB" if keyword.endswith("_mb") else ""
            words += [f"--{name}={_word(item)}{unit}" for item in _items(value, option["is_repeatable"])]
    return [*words, "--", *positions]


def option_of(command: str, keyword: str) -> str:
    """The option or position that a keyword argument of a command is."""
    renamed = RENAMED.get((command, keyword)) or RENAMED.get(("*", keyword))
    if renamed is not None:
        return renamed
    known = described_arguments()[command]
    name = keyword.replace("_", "-")
    for candidate in (keyword, name, *(name.removesuffix(unit.replace("_", "-")) for unit in UNITS)):
        if candidate in known:
            return candidate
    return name


@functools.cache
def described_arguments() -> dict[str, dict[str, dict[str, Any]]]:
    """The arguments of each command by their names."""
    described = json.loads(_satgs.arguments())
    return {command: {a["name"]: a for a in arguments} for command, arguments in described.items()}


def listener(progress: object) -> Progress:
    """The callback of a call."""
    if progress is None or progress is False:
        return _warn
    return ProgressBars() if progress is True else typing.cast(Progress, progress)


def _items(value: object, is_repeatable: bool) -> list[object]:
    if isinstance(value, Mapping):
        return [f"{name}={_word(item)}" for name, item in value.items()]
    return list(typing.cast(Any, value)) if is_repeatable else [value]


def _word(value: object) -> str:
    """A value as a word of the command line. Numbers have as many digits as tell them apart from all others."""
    if isinstance(value, str | os.PathLike):
        return os.fspath(value)
    if isinstance(value, numbers.Integral):
        return str(int(value))
    if isinstance(value, numbers.Real):
        return repr(float(value))
    return ",".join(_word(item) for item in typing.cast(Any, value))


def _documentation(of_options: Any, name: str) -> str:
    """The documentation of an option: that of the dictionary type, else of the one that it inherits the option from, whose
    options it has all."""
    keys = set(of_options.__annotations__)
    others = [t for t in vars(options).values() if isinstance(t, type) and hasattr(t, "__total__")]
    parts = [t for t in others if set(t.__annotations__) < keys]
    for part in [of_options, *parts]:
        entries = _entries(part.__doc__ or "")
        if name in entries:
            return entries[name]
    return ""


def _entries(doc: str) -> dict[str, str]:
    """The entries below `Args:`."""
    entries: dict[str, str] = {}
    name = ""
    for line in inspect.cleandoc(doc).partition("Args:\n")[2].split("\n"):
        if line.startswith("    ") and not line.startswith("     "):
            name, _, entries_text = line.strip().partition(": ")
            entries[name] = entries_text
        elif name and line.strip():
            entries[name] += "\n" + " " * 12 + line.strip()
    return entries


def _warn(event: Event) -> None:
    """The callback of calls that have none."""
    if isinstance(event, events.Warning):
        # Seen from the line that called satgs.
        level, frame = 1, sys._getframe()
        while frame.f_back is not None and frame.f_globals.get("__name__", "").split(".")[0] == "satgs":
            level, frame = level + 1, frame.f_back
        warnings.warn(event.text, SatgsWarning, stacklevel=level)
