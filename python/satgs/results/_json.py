"""Objects of result classes from JSON."""

from __future__ import annotations

import dataclasses
import json
import types
import typing
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")


def from_json(result: type[T], text: str, **more: object) -> T:
    """An object of a result class from JSON, and from values that the JSON does not hold."""
    return typing.cast(T, _made(result, json.loads(text) | more))


def _made(kind: Any, value: Any) -> Any:
    """A value of JSON as an annotated type."""
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        types_of = typing.get_type_hints(kind)
        keys = {f.name: f.metadata.get("key", f.name) for f in dataclasses.fields(kind)}
        report_unknown(kind, set(value) - set(keys.values()))
        # Only fields with a default may be missing.
        known = [f.name for f in dataclasses.fields(kind) if keys[f.name] in value or f.default is dataclasses.MISSING]
        return kind(**{name: _made(types_of[name], value[keys[name]]) for name in known})
    arguments = typing.get_args(kind)
    origin = typing.get_origin(kind)
    if origin is tuple:
        of_all = arguments[:1] * len(value) if arguments[-1] is Ellipsis else arguments
        return tuple(_made(item, v) for item, v in zip(of_all, value))
    if origin is dict:
        return {name: _made(arguments[1], item) for name, item in value.items()}
    if origin is types.UnionType:
        return None if value is None else _made(_fitting(arguments, value), value)
    if kind is float:
        return float("nan") if value is None else float(value)
    return Path(value) if kind is Path else value


def _fitting(kinds: tuple[Any, ...], value: Any) -> Any:
    """The first class of a union that has a field for each key of a value, a tuple for a list, else the first other type."""
    if not isinstance(value, dict):
        is_list = isinstance(value, list)
        return next((kind for kind in kinds if (typing.get_origin(kind) is tuple) == is_list), kinds[0])
    classes = [kind for kind in kinds if dataclasses.is_dataclass(kind)]
    has_all = (kind for kind in classes if set(value) <= {f.name for f in dataclasses.fields(kind)})
    return next(has_all, kinds[0])


def report_unknown(kind: type, keys: set[str]) -> None:
    """Called with keys that a result class has no field for, which are dropped: a newer program may write more. Tests replace
    it by an error."""
