"""Exceptions: whose fault a failure is, what happened, and what to do about it."""

from __future__ import annotations


class SatgsError(Exception):
    """Why a call failed.

    Attributes:
        message: What happened, with the causes; it names the file and the field.
        hint: What to do about it, or ``None``. Options have the names of the command line there: ``--height-range`` is
            the argument ``height_range``.
    """

    message: str
    hint: str | None

    def __init__(self, message: str, hint: str | None = None) -> None:
        super().__init__(message, hint)
        self.message = message
        self.hint = hint

    def __str__(self) -> str:
        return self.message if self.hint is None else f"{self.message}\nhint: {self.hint}"


class InputError(SatgsError, ValueError):
    """The input or an option is wrong: the same call fails again."""


class FailedError(SatgsError, RuntimeError):
    """The input may be right, but the work failed: a file could not be written, a solver did not converge, the machine
    has too little memory or disk."""


class PartialError(FailedError):
    """A part of the work is done: some tiles of a large scene failed; the same call tries them again."""


class SatgsWarning(UserWarning):
    """A problem that does not stop the work, where no progress callback is given that would receive it."""
