"""Results as JSON and back by pydantic: a frozen dataclass is an object, its fields are the keys.

JSON has neither infinity nor nan. Both are written as null, and read as the field's type says.
"""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Callable
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import (
    BeforeValidator,
    Field,
    PlainSerializer,
    PlainValidator,
    TypeAdapter,
    ValidationError,
)

from nearlift.declare import FloatArray
from nearlift.errors import ProductError

#: Content of a JSON file.
Json = Any
Typed = TypeVar("Typed")


def _null_as(value: float) -> BeforeValidator:
    return BeforeValidator(lambda content: value if content is None else content)


#: Numbers by the meaning of null: nan, infinity, minus infinity.
Real = Annotated[float, _null_as(math.nan)]
Unbounded = Annotated[float, _null_as(math.inf)]
Above = Annotated[float, _null_as(math.inf)]
Below = Annotated[float, _null_as(-math.inf)]
#: A number as a key, with six digits.
NumberKey = Annotated[
    float, PlainSerializer(lambda number: f"{number:g}", return_type=str, when_used="json")
]
#: A field whose key is left out where it is None.
IfAny = Annotated[Typed | None, Field(exclude_if=lambda value: value is None)]
#: A field that is not written.
Unwritten = Annotated[Typed, Field(exclude=True)]
#: An array as a list of numbers.
Numbers = Annotated[
    FloatArray,
    PlainValidator(lambda content: np.array(content, dtype=float)),
    PlainSerializer(lambda array: array.tolist(), return_type=list[float], when_used="json"),
]


#: Adapter of a type; its schema is made once.
_adapter: Callable[[Any], TypeAdapter[Any]] = functools.cache(TypeAdapter)


def json_bytes(value: object, indent: int | None = 1) -> bytes:
    """The JSON text of a result; numbers keep all their digits."""
    kind: object = type(value) if hasattr(value, "__dataclass_fields__") else Any
    return _adapter(kind).dump_json(
        value, indent=indent, by_alias=True, warnings=False, fallback=lambda array: array.tolist()
    )


def as_json(value: object) -> Json:
    """A result as lists, texts and numbers."""
    return json.loads(json_bytes(value, None))


def typed(kind: type[Typed], content: Json, where: str = "") -> Typed:
    """A result of type `kind` from its JSON content; unknown keys are passed over.

    Raises
    ------
    ProductError
        A key is missing, or has another type; `where` is the file.
    """
    try:
        result: Typed = _adapter(kind).validate_python(content)
    except ValidationError as faults:
        fault = faults.errors()[0]
        raise ProductError(
            where or kind.__name__,
            "is damaged, or of another version:"
            f" {'.'.join(map(str, fault['loc']))}: {fault['msg']}",
            "delete it and run again",
        ) from None
    return result
