"""The JSON object of a frozen dataclass: its fields are the keys, in order."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

#: Of a field that is None, and not written, where there is nothing to say.
OPTIONAL = {"optional": True}


def encode(value: Any) -> Any:
    """Dataclasses as mappings, at any depth; all else as it is."""
    if isinstance(value, Mapping):
        return {k: encode(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [encode(v) for v in value]
    if dataclasses.is_dataclass(value):
        return {
            f.name: encode(content)
            for f in dataclasses.fields(value)
            if (content := getattr(value, f.name)) is not None or not f.metadata.get("optional")
        }
    return value
