"""How a text is laid out, as the manifest says in part and the sniffer completes."""

from __future__ import annotations

import codecs
from dataclasses import dataclass

from nearlift.errors import InputRefused
from nearlift.readers.table import BLANKS, NONE, CellSyntax

#: How a manifest may call a separator, in the order in which they are tried, and how a sentence
#: does.
NAMED = {"tab": "\t", "semicolon": ";", "comma": ",", "bar": "|", "blank": BLANKS, "none": NONE}
SPOKEN = {sign: f"{name}s" for name, sign in NAMED.items()} | {NONE: "line ends"}

_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Given:
    """What the manifest says of the dialect, under ``[records] dialect``; None or empty where it
    says nothing.

    `columns` and `units` name the cells of a file without a header; `skip` counts the lines above
    the header (or the first row); `ignore` lists whole lines that are no rows, in which ``*``
    stands for anything; `labels` says that cells are ``name: number``; `lines` how many lines of
    one number each make a row.
    """

    encoding: str | None = None
    separator: str | None = None
    decimal: str | None = None
    skip: int | None = None
    columns: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    ignore: tuple[str, ...] = ()
    labels: bool = False
    lines: int = 1


UNGIVEN = Given()


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """A whole dialect: cells, the columns' names and units, and the first row's line (from 1)."""

    encoding: str
    cells: CellSyntax
    names: tuple[str, ...]
    units: tuple[str, ...]
    first: int
    preamble: tuple[str, ...] = ()
    #: which columns are text
    texts: tuple[int, ...] = ()

    @property
    def numeric(self) -> list[int]:
        """Which columns are numbers."""
        return [i for i in range(len(self.names)) if i not in self.texts]

    def spoken(self) -> str:
        """The dialect in words; empty for plain CSV."""
        parts = []
        if self.encoding not in ("utf-8", "ascii"):
            names = {"utf-8-sig": "UTF-8 with a byte order mark", "cp1252": "Windows-1252"}
            parts.append(names.get(self.encoding, self.encoding.upper()))
        if self.cells.separator not in (",", NONE):
            parts.append(
                f"separated by {SPOKEN.get(self.cells.separator, repr(self.cells.separator))}"
            )
        if self.cells.decimal == ",":
            parts.append("decimal commas")
        if self.cells.trailing:
            parts.append("a separator at the end of every line")
        if self.cells.labels:
            parts.append("labelled cells")
        if self.preamble:
            parts.append(
                f"{len(self.preamble)} line{'s' * (len(self.preamble) > 1)} above the columns'"
                " names left out"
            )
        return ", ".join(parts)


def encoding_of(head: bytes, where: str) -> str:
    """The encoding of a file's first bytes; `InputRefused` where they are no text, or packed."""
    for mark, name in _MARKS:
        if head.startswith(mark):
            return name
    if head.startswith(
        (b"\x1f\x8b", b"PK\x03\x04", b"BZh", b"\xfd7zXZ", b"\x28\xb5\x2f\xfd", b"7z\xbc\xaf")
    ):
        raise InputRefused(
            where, "is compressed", "unpack it: what is inside is then digested and read as it is"
        )
    if b"\0" in head.rstrip(b"\0"):
        pairs = head[: len(head) // 2 * 2]
        for name, zeros in (("utf-16-le", pairs[1::2]), ("utf-16-be", pairs[0::2])):
            if zeros.count(0) > 0.9 * len(zeros):
                return name
        raise InputRefused(
            where,
            "is no text: it holds NUL bytes",
            "it is damaged, or binary of a format that is not read: docs/formats.md lists those"
            " that are; export it as text",
        )
    try:
        # a character may be cut at the end of the head
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        # the bytes 0x80 to 0x9f are control characters in Latin-1 and letters in Windows-1252
        return "cp1252" if any(0x80 <= byte < 0xA0 for byte in head) else "latin-1"
    return "utf-8"
