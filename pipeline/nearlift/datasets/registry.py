"""List of public data sets, read from `registry.toml` or from another list in the same form."""

from __future__ import annotations

import difflib
import re
import tomllib
from pathlib import Path

from pydantic import Field, ValidationError, field_validator

from nearlift.campaign.quantities import Section
from nearlift.errors import InputRefused, UsageError
from nearlift.rounding import bytes_text

OWN = Path(__file__).with_name("registry.toml")
#: Digest of a file for which none is known.
UNKNOWN = "unknown"
#: Modules of this package that make a campaign of files.
CONVERTERS = ("crazyflie_stand", "garofano_soldado", "jirs", "pitt_ras", "pitt_ras_older")


class PublicFile(Section):
    """One published file: its name here, where it is, and the SHA-256 by which it is known."""

    name: str
    url: str
    sha256: str
    bytes: int | None = None

    @field_validator("sha256")
    @classmethod
    def _a_digest(cls, value: str) -> str:
        if value != UNKNOWN and not re.fullmatch(r"[0-9a-f]{64}", value):
            raise ValueError(f"{value!r} is no SHA-256: 64 digits of 0-9a-f, or {UNKNOWN!r}")
        return value

    @field_validator("name")
    @classmethod
    def _a_name(cls, value: str) -> str:
        if re.search(r"[/\\\0]", value) or value.startswith(".") or not value.isprintable():
            raise ValueError(f"{value!r} is a path: give a plain file name")
        return value


class Dataset(Section):
    """Published data that can be made into a campaign. `next` is the command that makes sense of
    it.
    """

    name: str
    title: str
    licence: str
    citation: str
    home: str
    converter: str
    next: str
    note: str = ""
    file: list[PublicFile] = Field(min_length=1)

    @field_validator("name")
    @classmethod
    def _a_folder(cls, value: str) -> str:
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", value):
            raise ValueError(f"{value!r} names no folder: use letters, digits, '-', '_' and '.'")
        return value

    @field_validator("converter")
    @classmethod
    def _a_converter(cls, value: str) -> str:
        if value not in CONVERTERS:
            raise ValueError(f"{value!r} is no converter: there are {', '.join(CONVERTERS)}")
        return value

    @property
    def unknown(self) -> tuple[PublicFile, ...]:
        """The files without a digest."""
        return tuple(f for f in self.file if f.sha256 == UNKNOWN)


class _Registry(Section):
    dataset: list[Dataset]


def datasets(path: Path = OWN) -> tuple[Dataset, ...]:
    """Everything that is listed.

    Raises
    ------
    InputRefused
        The list cannot be read or breaks its form.
    """
    try:
        return tuple(
            _Registry.model_validate(tomllib.loads(path.read_text(encoding="utf-8"))).dataset
        )
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as fault:
        raise InputRefused(str(path), f"is not valid TOML ({fault})", "correct it") from None
    except ValidationError as fault:
        first = fault.errors()[0]
        raise InputRefused(
            str(path),
            f"{'.'.join(str(p) for p in first['loc'])}:"
            f" {first['msg'].removeprefix('Value error, ')}",
            "correct that entry",
        ) from None


def dataset(name: str, path: Path = OWN) -> Dataset:
    """The data set of that name; `UsageError` with near matches."""
    known = {d.name: d for d in datasets(path)}
    if name not in known:
        close = difflib.get_close_matches(name, known, n=1, cutoff=0.4)
        raise UsageError(
            name,
            "is no data set",
            f"did you mean {close[0]!r}?" if close else f"there are {', '.join(known)}",
        )
    return known[name]


def described(item: Dataset) -> list[str]:
    """Lines of the list of data sets: name, title, size, licence, citation."""
    sizes = [f.bytes for f in item.file]
    held = "size unknown" if None in sizes else bytes_text(sum(size or 0 for size in sizes))
    about = (
        item.title,
        f"{len(item.file)} file{'s' if len(item.file) > 1 else ''}, {held}; licence: {item.licence}",
        item.citation,
        item.note,
        "its digest is not known: wants --trust" if item.unknown else "",
    )
    return [item.name, *(f"  {line}" for line in about if line)]
