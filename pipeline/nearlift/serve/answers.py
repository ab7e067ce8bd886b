"""What a page is asked with, and what goes back."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from urllib.parse import parse_qs, quote

from nearlift.errors import InputRefused

#: Of a form of the page, ten times over.
MOST_FIELDS = 100
HTML = "text/html; charset=utf-8"
TEXT = "text/plain; charset=utf-8"


@dataclass(frozen=True, slots=True, kw_only=True)
class PageAnswer:
    """What goes back."""

    body: bytes = b""
    kind: str = HTML
    status: int = 200
    headers: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class PageQuery:
    """The fields of a request, each a list."""

    fields: Mapping[str, list[str]]

    @classmethod
    def parsed(cls, text: str) -> PageQuery:
        """Those of a query or a form.

        Raises
        ------
        InputRefused
            They are more than `MOST_FIELDS`.
        """
        try:
            return cls(parse_qs(text, keep_blank_values=True, max_num_fields=MOST_FIELDS))
        except ValueError:
            raise InputRefused("this form", f"has more than {MOST_FIELDS} fields") from None

    def one(self, name: str, otherwise: str = "") -> str:
        """A field's first value."""
        return self.fields.get(name, [otherwise])[0]

    def all(self, name: str) -> list[str]:
        """All its values."""
        return self.fields.get(name, [])

    def text(self, name: str) -> str:
        """A text of many lines, which forms send with other ends of lines."""
        return self.one(name).replace("\r\n", "\n")


def see(path: str, **query: str) -> PageAnswer:
    """Go there."""
    where = path + ("?" + "&".join(f"{k}={quote(v)}" for k, v in query.items()) if query else "")
    return PageAnswer(body=b"", status=303, headers={"location": where})


def as_json(content: object) -> PageAnswer:
    """A JSON answer."""
    return PageAnswer(body=json.dumps(content).encode(), kind="application/json")
