"""Results as JSON and back: the fields of a frozen dataclass are the keys of its object, in order.

A field may have a key that is no Python name (`keyed`), be left out where it says nothing
(`optional`), or be the key of its object in the object above (`named_by_key`). JSON
has neither infinity nor nan: both are written as null, and read as what the field's type says
(`Unbounded`, `Below`, `Above`), nan where it says nothing. A type that keeps itself (`record`,
`recorded`) is asked.
"""

from __future__ import annotations

import dataclasses
import math
import types
from collections.abc import Callable, Mapping
from functools import cache
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from nearlift.errors import ProductError

#: What JSON holds.
Json = Any
Typed = TypeVar("Typed")

#: A number that null stands for infinity of.
Unbounded = Annotated[float, math.inf]
Below = Annotated[float, -math.inf]
Above = Annotated[float, math.inf]


def keyed(key: str) -> Any:
    """A field under another key."""
    return dataclasses.field(metadata={"key": key})


def optional(key: str = "") -> Any:
    """A field that is None, and not written, where there is nothing to say."""
    return dataclasses.field(default=None, metadata={"key": key, "optional": True})


def named_by_key() -> Any:
    """A field that holds the key of its object in the object above, and is not written."""
    return dataclasses.field(default="", compare=False, metadata={"above": True})


@dataclasses.dataclass(frozen=True, slots=True)
class Nothing:
    """Written as an object without keys: the question has no answer here."""

    def __bool__(self) -> bool:
        return False


def encode(value: Any) -> Json:
    """The JSON form of a value: types and numpy unwrapped, what is not finite becomes null."""
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, str | int | None):
        return value
    if isinstance(value, Mapping):
        return {_key(k): encode(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [encode(v) for v in value]
    if isinstance(value, np.ndarray | np.generic):
        return encode(value.tolist())
    if hasattr(value, "record"):
        return encode(value.record())
    if dataclasses.is_dataclass(value):
        return {
            key: encode(content)
            for key, field in _written(type(value))  # type: ignore[arg-type]
            if (content := getattr(value, field.name)) is not None
            or not field.metadata.get("optional")
        }
    return value


def _key(key: object) -> str:
    return f"{key:g}" if isinstance(key, float) else str(key)


@cache
def _written(kind: Any) -> tuple[tuple[str, dataclasses.Field[Any]], ...]:
    """Key and field of all that is written of a dataclass; of any other type nothing."""
    return tuple(
        (f.metadata.get("key") or f.name, f)
        for f in (dataclasses.fields(kind) if dataclasses.is_dataclass(kind) else ())
        if not f.metadata.get("above")
    )


def decode(kind: type[Typed], content: Json, where: str = "") -> Typed:
    """A value of type `kind` from its JSON form; keys that the type does not know are passed over.

    Raises
    ------
    ProductError
        A key is missing, or holds something else; `where` is the file.
    """
    try:
        read: Callable[[Json], Typed] = _decoder(kind)  # type: ignore[arg-type]
        return read(content)
    except (LookupError, TypeError, ValueError, AttributeError) as fault:
        raise ProductError(
            where or kind.__name__,
            f"is damaged, or of another version: {fault}",
            "delete it and run again",
        ) from None


@cache
def _decoder(kind: Any) -> Callable[[Json], Any]:
    if kind in (Any, object, str, bool, int, types.NoneType) or get_origin(kind) is Literal:
        return lambda content: content
    if kind is float:
        return lambda content: math.nan if content is None else float(content)
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Annotated:
        null = inner[1]
        return lambda content: null if content is None else float(content)
    if origin in (Union, types.UnionType):
        return _of_union(inner)
    if origin is tuple and inner[-1] is Ellipsis:
        each = _decoder(inner[0])
        return lambda content: tuple(map(each, content))
    if origin is tuple:
        parts = [_decoder(part) for part in inner]
        return lambda content: tuple(p(c) for p, c in zip(parts, content, strict=True))
    if origin is np.ndarray:
        return lambda content: np.asarray(content, dtype=float)
    if origin is not None and issubclass(origin, Mapping):
        return _of_mapping(*inner)
    # a field may have this name too
    recorded: object = getattr(kind, "recorded", None)
    return recorded if isinstance(recorded, types.MethodType) else _of_record(kind)


def _of_union(members: tuple[Any, ...]) -> Callable[[Json], Any]:
    """Nothing and None by their content, else the first of several types whose keys are all
    there.
    """
    kinds = [m for m in members if m is not type(None) and m is not Nothing]
    needed = [{key for key, field in _written(kind) if _required(field)} for kind in kinds]

    def read(content: Json) -> Any:
        if content is None and type(None) in members:
            return None
        if content == {} and Nothing in members:
            return Nothing()
        if len(kinds) == 1:
            return _decoder(kinds[0])(content)
        kind = next(k for k, keys in zip(kinds, needed, strict=True) if keys <= content.keys())
        return _decoder(kind)(content)

    return read


def _required(field: dataclasses.Field[Any]) -> bool:
    return field.default is field.default_factory is dataclasses.MISSING


def _of_mapping(key: Any, value: Any) -> Callable[[Json], Any]:
    each, name = _decoder(value), float if key is float else str
    return lambda content: {name(k): _named(each(v), k) for k, v in content.items()}


def _named(value: Any, key: str) -> Any:
    fields = dataclasses.fields(value) if dataclasses.is_dataclass(value) else ()
    above = [f.name for f in fields if f.metadata.get("above")]
    return dataclasses.replace(value, **dict.fromkeys(above, key)) if above else value


def _of_record(kind: Any) -> Callable[[Json], Any]:
    hints = get_type_hints(kind, include_extras=True)
    readers = [(key, field, _decoder(hints[field.name])) for key, field in _written(kind)]

    def read(content: Json) -> Any:
        for key, field, _ in readers:
            if _required(field) and key not in content:
                raise LookupError(f"{kind.__name__} lacks {key!r}")
        return kind(**{f.name: each(content[key]) for key, f, each in readers if key in content})

    return read
