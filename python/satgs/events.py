"""What long work tells a progress callback.

A callback takes one event and returns nothing::

    def show(event: satgs.Event) -> None:
        if isinstance(event, satgs.events.Advanced):
            print(event.done, event.status)

It is called in the thread that called satgs, between units of the work; an exception that it raises stops the work, which
leaves a checkpoint where it can, and is raised by the call.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Union


@dataclass(frozen=True)
class Started:
    """A step of the work begins.

    Attributes:
        stage: What the step does, for example ``matching pairs``.
        total: Number of units of work, 0 when unknown.
    """

    stage: str
    total: int


@dataclass(frozen=True)
class Advanced:
    """Some units of the present step are complete.

    Attributes:
        done: Number of units done so far.
        status: Figures of the moment, for example ``loss 0.031, 93000 splats``; may be empty.
    """

    done: int
    status: str


@dataclass(frozen=True)
class Finished:
    """The present step is complete."""


@dataclass(frozen=True)
class Resumable:
    """Whether work that is asked to stop from here on leaves a checkpoint; before the first such event it does not.

    Attributes:
        is_resumable: Whether it leaves one.
    """

    is_resumable: bool


@dataclass(frozen=True)
class Note:
    """Information for the user.

    Attributes:
        text: The information.
    """

    text: str


@dataclass(frozen=True)
class Warning:
    """A problem that does not stop the work.

    Attributes:
        text: The problem.
    """

    text: str


Event = Union[Started, Advanced, Finished, Resumable, Note, Warning]
"""Any event."""

Progress = Callable[[Event], None]
"""A progress callback."""


class ProgressBars:
    """A progress callback that shows a bar of tqdm for each step, and prints notes and warnings above it.

    ``progress=True`` makes one.

    Raises:
        ImportError: tqdm is not installed.
    """

    def __init__(self) -> None:
        try:
            self._tqdm: Any = import_module("tqdm.auto").tqdm
        except ImportError as error:
            raise ImportError("progress=True shows bars of tqdm, which is not installed: pip install tqdm") from error
        self._bar: Any = None

    def __call__(self, event: Event) -> None:
        if isinstance(event, Started):
            self._close()
            self._bar = self._tqdm(total=event.total or None, desc=event.stage)
        elif isinstance(event, Advanced) and self._bar is not None:
            self._bar.update(event.done - self._bar.n)
            self._bar.set_postfix_str(event.status)
        elif isinstance(event, Finished):
            self._close()
        elif isinstance(event, (Note, Warning)):
            word = "warning: " if isinstance(event, Warning) else ""
            self._tqdm.write(word + event.text)

    def _close(self) -> None:
        if self._bar is not None:
            self._bar.close()
            self._bar = None
