"""The program satgs: what its help says, and how it runs. Nothing here needs QGIS."""

from __future__ import annotations

import json
import os
import queue
import re
import subprocess
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

LEFT_OUT = ("", "Options of all commands", "Examples")
"""Headings of what is no argument, and of the options that the plugin sets itself."""
NO_ANSWER_S = 30.0
"""Help takes a fraction of a second."""
CHECK_EVERY_S = 0.2
"""How often a running command is asked whether it is to stop."""
PARTIAL = 3
"""Exit code of a command that is complete but for a part, which its standard error names."""
TIME_TO_STOP_S = 120.0
"""An interrupted training writes its checkpoint."""

HEADING = re.compile(r"^(\S.*):$")
ARGUMENT = re.compile(r"^ {2,6}(?:-\w, )?(?:--(?P<option>[\w-]+))?\s?(?:[<\[](?P<value>[^\]>]+)[\]>](?:\.\.\.)?)?$")
POSSIBLE_VALUES = re.compile(r"\[possible values: ([^\]]+)\]")
VALUE_OF_LIST = re.compile(r"^- ([\w-]+):", re.MULTILINE)


@dataclass
class Argument:
    """An argument of a command as its help describes it.

    ``option`` is its name with the dashes, or None of a position; ``value`` what stands for its value, or None of a flag.
    """

    option: str | None
    value: str | None
    text: str = ""

    @property
    def name(self) -> str:
        """A name for parameters: that of the option, or of the position."""
        return (self.option or self.value or "").lstrip("-").lower().replace("-", "_")

    @property
    def summary(self) -> str:
        """The first sentence."""
        return self.text.split("\n\n")[0].replace("\n", " ")

    @property
    def values(self) -> list[str]:
        """The values that it can have, if they are listed."""
        listed = POSSIBLE_VALUES.search(self.text.replace("\n", " "))
        return listed.group(1).split(", ") if listed else VALUE_OF_LIST.findall(self.text)


@dataclass
class Help:
    """What a command does, and its arguments but for those of all commands."""

    summary: str = ""
    description: str = ""
    arguments: list[Argument] = field(default_factory=list)


def parse_help(text: str) -> Help:
    """Reads what ``satgs COMMAND --help`` prints."""
    before, _, after = text.partition("\nUsage:")
    summary, _, description = before.strip().partition("\n\n")
    found = Help(" ".join(summary.split()), description)
    heading = ""
    for line in after.splitlines()[1:]:
        if match := HEADING.match(line):
            heading = match.group(1)
        elif line and not line.startswith(" "):
            heading = ""  # What follows the options belongs to none.
        elif heading in LEFT_OUT:
            continue
        elif (match := ARGUMENT.match(line)) and (match["option"] or match["value"]):
            option = f"--{match['option']}" if match["option"] else None
            found.arguments.append(Argument(option, match["value"]))
        elif found.arguments:
            found.arguments[-1].text += line.strip() + "\n"
    for argument in found.arguments:
        argument.text = argument.text.strip()
    return found


def help_of(program: str, command: str) -> Help:
    """The help of a command; an empty one if the program does not answer, as where it is not installed."""
    try:
        asked = subprocess.run(
            [program, command, "--help"], capture_output=True, text=True, timeout=NO_ANSWER_S, check=True, env=_environment()
        )
    except (OSError, subprocess.SubprocessError):
        return Help()
    return parse_help(asked.stdout)


class CommandError(Exception):
    """A command that failed, with what it said."""


class Cancelled(Exception):
    """A command that was asked to stop and did."""


def run(
    program: str, words: list[str], on_event: Callable[[dict], None], is_cancelled: Callable[[], bool]
) -> dict:
    """Runs a command and returns its summary. ``on_event`` gets the events of ``--events``, and, of a command that is complete but
    for a part, what is missing as a warning."""
    try:
        process = subprocess.Popen(
            [program, words[0], "--events", "--quiet", *words[1:]],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            env=_environment(),
        )
    except OSError as error:
        message = f"`{program}` cannot be started: {error.strerror}. Its path is a setting: Settings, Options, Processing, Providers, satgs"
        raise CommandError(message) from error
    lines: queue.Queue[str | None] = queue.Queue()
    said: list[str] = []
    readers = [
        threading.Thread(target=_read, args=(process.stdout, lines.put), daemon=True),
        threading.Thread(target=_read, args=(process.stderr, lambda line: said.append(line or "")), daemon=True),
    ]
    for reader in readers:
        reader.start()
    summary: dict = {}
    try:
        while True:
            if is_cancelled():
                raise Cancelled
            try:
                line = lines.get(timeout=CHECK_EVERY_S)
            except queue.Empty:
                continue
            if line is None:
                break
            event = _event(line)
            if event.get("event") == "summary":
                summary = event.get("summary") or {}
            elif event:
                on_event(event)
    except BaseException:
        _stop(process)
        raise
    code = process.wait()
    readers[1].join()
    errors = "".join(said).strip()
    if code == PARTIAL:
        on_event({"event": "warning", "text": errors})
    elif code != 0:
        raise CommandError(errors or f"`{program}` stopped with code {code}")
    return summary


def words_of(arguments: list[Argument], values: dict[str, object]) -> list[str]:
    """The words of a command line: values by the names of arguments. None, False and empty texts are left out."""
    options, positions = [], []
    for argument in arguments:
        value = values.get(argument.name)
        if value is None or value is False or value == "":
            continue
        if argument.option is None:
            positions.append(str(value))
        elif value is True:
            options.append(argument.option)
        else:
            options.append(f"{argument.option}={value}")
    return [*options, "--", *positions]


def _read(stream, take: Callable[[str | None], None]) -> None:
    with stream:
        for line in stream:
            take(line)
    take(None)


def _event(line: str) -> dict:
    try:
        event = json.loads(line)
    except ValueError:
        return {}
    return event if isinstance(event, dict) else {}


def _stop(process: subprocess.Popen) -> None:
    process.terminate()
    try:
        process.wait(TIME_TO_STOP_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _environment() -> dict[str, str]:
    """That of QGIS without its Python and its data of GDAL and PROJ, which may be of other versions than those of satgs."""
    of_qgis = {"PYTHONHOME", "PYTHONPATH", "GDAL_DATA", "GDAL_DRIVER_PATH", "PROJ_LIB", "PROJ_DATA"}
    return {name: value for name, value in os.environ.items() if name not in of_qgis}
