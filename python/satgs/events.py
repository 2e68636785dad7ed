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
from typing import Union


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
