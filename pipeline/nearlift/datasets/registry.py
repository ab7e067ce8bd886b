"""List of public data sets, read from `registry.toml` or from another list in the same form."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field, ValidationError

from nearlift.campaign.quantities import Section
from nearlift.datasets.converters import CONVERTERS
from nearlift.errors import InputRefused, UsageError, brief, did_you_mean
from nearlift.rounding import bytes_text

OWN = Path(__file__).with_name("registry.toml")


def _converter(value: str) -> str:
    if value not in CONVERTERS:
        raise ValueError(f"there is no such converter; there are {', '.join(CONVERTERS)}")
    return value


#: A name that leads into no other folder.
PlainName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]


class PublicFile(Section):
    """One published file, known by its SHA-256."""

    name: PlainName
    url: Annotated[str, Field(pattern=r"^https?://")]
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    bytes: int


class Dataset(Section):
    """Published data that can be made into a campaign; `next` is the command to run then."""

    name: PlainName
    title: str
    licence: str
    citation: str
    home: str
    converter: Annotated[str, AfterValidator(_converter)]
    next: str
    note: str = ""
    file: list[PublicFile] = Field(min_length=1)

    def __str__(self) -> str:
        size = bytes_text(sum(file.bytes for file in self.file))
        files = f"{len(self.file)} file{'s' * (len(self.file) > 1)}, {size}"
        about = (self.title, f"{files}; licence: {self.licence}", self.citation, self.note)
        return "\n  ".join([self.name, *filter(None, about)])


class _Registry(Section):
    dataset: list[Dataset]


def datasets(path: Path = OWN) -> dict[str, Dataset]:
    """Every data set that is listed, by name.

    Raises
    ------
    InputRefused
        The list cannot be read or breaks its form.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        return {item.name: item for item in _Registry.model_validate(content).dataset}
    except ValidationError as fault:
        first = fault.errors()[0]
        key = ".".join(map(str, first["loc"]))
        message = first["msg"].removeprefix("Value error, ")
        what = f"{key} = {brief(repr(first['input']), 80)}: {message}"
        raise InputRefused(str(path), what, "correct that entry") from None
    except ValueError as fault:
        raise InputRefused(str(path), f"is not valid TOML ({fault})", "correct it") from None


def dataset(name: str, path: Path = OWN) -> Dataset:
    """The data set of that name; `UsageError` with near matches."""
    known = datasets(path)
    if name not in known:
        remedy = did_you_mean(name, known) or f"there are {', '.join(known)}"
        raise UsageError(name, "is no data set", remedy)
    return known[name]
