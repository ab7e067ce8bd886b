"""Tags and numbers of a page, and the stored number that a pointer names."""

from __future__ import annotations

from html.parser import HTMLParser


class Elements(HTMLParser):
    """Tags with their attributes; numbers with the attributes that name their source."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.numbers: list[tuple[dict[str, str | None], str]] = []
        self.inside: dict[str, str | None] | None = None
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))
        if tag == "data":
            self.inside = dict(attrs)

    def handle_endtag(self, tag):
        if tag == "data":
            self.inside = None

    def handle_data(self, data):
        if self.inside is not None:
            self.numbers.append((self.inside, data))

    def every(self, tag):
        return [attributes for name, attributes in self.found if name == tag]


def follow(content, pointer):
    """The part of a JSON document at a JSON pointer."""
    for key in pointer.split("/")[1:]:
        key = key.replace("~1", "/").replace("~0", "~")
        content = content[int(key)] if isinstance(content, list) else content[key]
    return content
