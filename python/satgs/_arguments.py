"""Checks of arguments by their annotations, before the extension module sees them: an error names the argument, what was
found and what is expected."""

from __future__ import annotations

import collections.abc
import numbers
import os
import types
import typing
from collections.abc import Mapping
from typing import Any

from satgs.errors import InputError

_WORDS: dict[object, str] = {
    bool: "True or False",
    int: "a whole number",
    float: "a number",
    str: "a text",
    os.PathLike: "a path",
}


def check(call: str, kinds: Mapping[str, Any], arguments: Mapping[str, object]) -> None:
    """Checks the arguments of a call of this package by their annotated types.

    Raises:
        TypeError: There is no such argument, or it is of another type than its annotation.
        InputError: A whole number is negative.
    """
    for name, value in arguments.items():
        if name not in kinds:
            raise TypeError(f"{call}() got an unexpected keyword argument {name!r} (help(satgs.{call}))")
        kind = kinds[name]
        parts = typing.get_args(kind)
        if value is None and types.NoneType in parts:
            continue
        if not _fits(value, kind):
            raise TypeError(f"`{name}` is {value!r}, expected {_words(kind)} (help(satgs.{call}))")
        if int in parts and isinstance(value, numbers.Integral) and value < 0:
            raise InputError(f"`{name}` is {value!r}, expected a number from 0 on")


def _fits(value: object, kind: Any) -> bool:
    """Whether a value is of an annotated type. Whole numbers are numbers, and those of NumPy count."""
    origin, parts = typing.get_origin(kind) or kind, typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        return any(_fits(value, part) for part in parts)
    if origin is typing.Literal:
        # Which of the values there are, the library says.
        return isinstance(value, type(parts[0]))
    if origin is bool or isinstance(value, bool):
        return origin is bool and isinstance(value, bool)
    if origin is int:
        return isinstance(value, numbers.Integral)
    if origin is float:
        return isinstance(value, numbers.Real)
    if origin is tuple:
        items = list(typing.cast(Any, value)) if _is_list(value) else []
        return _is_list(value) and len(items) == len(parts) and all(map(_fits, items, parts))
    if origin is collections.abc.Sequence:
        return _is_list(value) and all(_fits(item, parts[0]) for item in typing.cast(Any, value))
    if origin is collections.abc.Mapping:
        is_mapping = isinstance(value, Mapping)
        return is_mapping and all(_fits(k, parts[0]) and _fits(v, parts[1]) for k, v in typing.cast(Any, value).items())
    if origin is collections.abc.Callable:
        return callable(value)
    return isinstance(value, origin)


def _is_list(value: object) -> bool:
    """Whether a value has items: scalars of NumPy have none."""
    return isinstance(value, (tuple, list)) or getattr(value, "ndim", 0) > 0


def _words(kind: Any) -> str:
    """An annotated type in words, without `None`."""
    origin, parts = typing.get_origin(kind) or kind, typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        is_path = any(typing.get_origin(part) is os.PathLike for part in parts)
        unsaid = (types.NoneType, str) if is_path else (types.NoneType,)
        words = [_words(part) for part in parts if part not in unsaid]
        return " or ".join(dict.fromkeys(words))
    if origin is typing.Literal:
        return " or ".join(repr(part) for part in parts)
    if origin is tuple:
        return f"{len(parts)} values, each {_words(parts[0])}"
    if origin is collections.abc.Sequence:
        return f"a list, each item {_words(parts[0])}"
    if origin is collections.abc.Mapping:
        return f"a dictionary, each value {_words(parts[1])}"
    if origin is collections.abc.Callable:
        return "a function"
    return _WORDS.get(origin, str(origin))
