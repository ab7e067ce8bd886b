"""The schema of a product: which file, which columns, in which unit, meaning what."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from numpy.typing import NDArray

Kind = Literal["text", "real", "integer"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """One column: its name (with the unit in it), kind, unit and meaning; an `optional` one may be
    absent.
    """

    name: str
    kind: Kind = "real"
    unit: str = ""
    meaning: str
    optional: bool = False


def text(name: str, meaning: str, *, optional: bool = False) -> Column:
    """A column of words."""
    return Column(name=name, kind="text", meaning=meaning, optional=optional)


def integer(name: str, meaning: str, *, unit: str = "", optional: bool = False) -> Column:
    """A column of whole numbers."""
    return Column(name=name, kind="integer", unit=unit, meaning=meaning, optional=optional)


def real(name: str, unit: str, meaning: str, *, optional: bool = False) -> Column:
    """A column of measured or computed numbers."""
    return Column(name=name, unit=unit, meaning=meaning, optional=optional)


@dataclass(frozen=True, slots=True, kw_only=True)
class Product:
    """One file that a stage writes. Tables may carry further columns where `open_ended`."""

    file: str
    title: str
    row: str
    columns: tuple[Column, ...] = ()
    open_ended: bool = False
    called: str = ""
    version: int = 1

    @property
    def name(self) -> str:
        """What it is `called`; else the file's name without its suffix."""
        return self.called or self.file.split(".")[0]

    @property
    def schema(self) -> str:
        """Identifier written into the file."""
        return f"nearlift.{self.file.split('.')[0]}/{self.version}"

    def columns_of(self, rows: Sequence[Mapping[str, object]]) -> dict[str, NDArray[Any]]:
        """Rows as this table's columns."""
        # schemas are read where the command line is set out, which wants no numpy
        import numpy as np

        kinds: dict[Kind, Any] = {"text": object, "integer": np.int64, "real": float}
        return {
            c.name: np.array([row[c.name] for row in rows], dtype=kinds[c.kind])
            for c in self.columns
        }
