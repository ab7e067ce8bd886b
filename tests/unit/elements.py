"""Tags and numbers of a page, and the stored number that a pointer names."""

from __future__ import annotations

from html.parser import HTMLParser

VOID = {"meta", "link", "img", "br", "input", "path"}


class Elements(HTMLParser):
    """Tags in order, each with its attributes and its ancestors' tags; numbers with the attributes
    that name their source. Every element must be closed where it was opened.
    """

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.found: list[tuple[str, dict[str, str | None], tuple[str, ...]]] = []
        self.numbers: list[tuple[dict[str, str | None], str]] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs), tuple(self.open)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] == "data":
            self.numbers.append((self.found[-1][1], data))

    def every(self, tag):
        return [attributes for name, attributes, _ in self.found if name == tag]


def follow(content, pointer):
    """The part of a JSON document at a JSON pointer."""
    for key in pointer.split("/")[1:]:
        key = key.replace("~1", "/").replace("~0", "~")
        content = content[int(key)] if isinstance(content, list) else content[key]
    return content
