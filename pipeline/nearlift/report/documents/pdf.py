"""report.pdf: what was found and how in two pages, then every figure as it was drawn, with its
caption. The same report gives the same bytes.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import matplotlib
from pypdf import PageObject, PdfReader, PdfWriter
from pypdf.generic import ArrayObject, DecodedStreamObject, DictionaryObject, NameObject
from reportlab.lib.pagesizes import A4
from reportlab.lib.styles import ParagraphStyle
from reportlab.pdfbase import pdfmetrics
from reportlab.pdfbase.ttfonts import TTFont
from reportlab.platypus import (
    BaseDocTemplate,
    Flowable,
    Frame,
    KeepTogether,
    PageBreak,
    PageTemplate,
    Paragraph,
    Spacer,
    Table,
)

import nearlift
from nearlift.catalogue import titled
from nearlift.nomenclature import INDEXED, VERDICTS, letter
from nearlift.products import RESULTS, TRIALS
from nearlift.reduction.quality import rejected
from nearlift.report.documents import methods
from nearlift.report.documents.brief import SOURCES, Brief, briefs
from nearlift.report.evidence import Evidence
from nearlift.report.page.render import Picture
from nearlift.rounding import fixed, like, plain

MARGIN = 54.0
WIDTH, HEIGHT = A4[0] - 2 * MARGIN, A4[1] - 2 * MARGIN
#: The figure that stands in the text; the others are the appendix.
FIRST = "fig2"
#: Of the doubts about a boundary so many are told.
DOUBTS = 3
#: matplotlib's, so that text and figures match; the last serves letters that the others lack.
FONTS = {
    "Serif": "STIXGeneral",
    "Serif-Italic": "STIXGeneralItalic",
    "Serif-Bold": "STIXGeneralBol",
    "Other": "DejaVuSans",
}
TEXT = ParagraphStyle("text", fontName="Serif", fontSize=9, leading=11, spaceAfter=4)
SMALL = ParagraphStyle("small", TEXT, fontSize=8, leading=9.6)
TITLE = ParagraphStyle("title", TEXT, fontName="Serif-Bold", fontSize=15, leading=18)
HEADING = ParagraphStyle(
    "heading",
    TEXT,
    fontName="Serif-Bold",
    fontSize=10.5,
    leading=13,
    spaceBefore=6,
    spaceAfter=2,
    keepWithNext=1,
)


#: A picture, and its PDF.
Drawn = tuple[Picture, bytes]


def pdf(evidence: Evidence, figures: Sequence[Drawn]) -> bytes:
    """The whole file."""
    _fonts()
    content = io.BytesIO()
    name = evidence.campaign.name
    whole = BaseDocTemplate(
        content,
        pagesize=A4,
        title=f"{name}: lift near boundaries",
        creator=f"nearlift {nearlift.__version__}",
        lang="en",
        initialFontName="Serif",
        invariant=1,
    )
    digest = evidence.digests.get(RESULTS.file, "")[:12]
    foot = f"{name}; nearlift {nearlift.__version__}; {RESULTS.file} {digest}"

    def footer(canvas: Any, _: Any) -> None:
        canvas.setFont("Serif", 8)
        canvas.drawString(MARGIN, MARGIN - 22, foot)
        canvas.drawRightString(A4[0] - MARGIN, MARGIN - 22, str(canvas.getPageNumber()))

    frame = Frame(MARGIN, MARGIN, WIDTH, HEIGHT, 0, 0, 0, 0)
    whole.addPageTemplates([PageTemplate(frames=[frame], onPage=footer)])
    placed: list[Space] = []
    whole.build(_flow(evidence, figures, placed))
    return _with_figures(content, placed)


def _fonts() -> None:
    folder = Path(matplotlib.get_data_path(), "fonts", "ttf")
    for name, file in FONTS.items():
        if name not in pdfmetrics.getRegisteredFontNames():
            pdfmetrics.registerFont(TTFont(name, str(folder / f"{file}.ttf")))
    pdfmetrics.registerFontFamily(
        "Serif", normal="Serif", bold="Serif-Bold", italic="Serif-Italic", boldItalic="Serif-Bold"
    )


def _flow(evidence: Evidence, figures: Sequence[Drawn], placed: list[Space]) -> list[Flowable]:
    trials = rejected(evidence.table(TRIALS)["quality"])
    vehicle = evidence.campaign.vehicle
    simulated = "; simulated records" if evidence.campaign.simulated else ""
    boundaries = briefs(evidence)
    first = [(picture, drawn) for picture, drawn in figures if picture.name == FIRST]
    rest = [(picture, drawn) for picture, drawn in figures if picture.name != FIRST]
    flow: list[Flowable] = [
        Paragraph(_set(f"{evidence.campaign.name}: lift near boundaries"), TITLE),
        Paragraph(
            _set(
                f"{vehicle.name}; {len(trials)} trials, {int(trials.sum()) or 'none'} left"
                f" out{simulated}"
            ),
            TEXT,
        ),
        Paragraph("The numbers to quote", HEADING),
        _quoted(boundaries),
        Spacer(1, 6),
        *(_figure(f, "Figure 1", placed) for f in first),
        Paragraph("What was found", HEADING),
        *(Paragraph(_found(brief), TEXT) for brief in boundaries),
        Paragraph("Where the uncertainty comes from", HEADING),
        _sources(boundaries),
        Paragraph("What the first coefficient would be on another condition", HEADING),
        _conditions(boundaries),
        Paragraph("Methods", HEADING),
        *(Paragraph(_set(p), SMALL) for p in methods.facts(evidence)["paragraphs"]),
        Paragraph("The same with citations: methods.tex, methods.md and references.bib.", SMALL),
    ]
    if rest:
        flow += [PageBreak(), Paragraph("Appendix: figures", HEADING)]
        flow += [_figure(f, f"Figure A{i}", placed) for i, f in enumerate(rest, start=1)]
    return flow


def _quoted(boundaries: Sequence[Brief]) -> Table:
    """Coefficients with ± u and interval, errors and verdict, a row each."""
    rows: list[Sequence[Any]] = [
        (
            *("boundary", "", "value ± u (k = 1)", "90 % interval"),
            *("error before", "after", "floor (% of lift)", "verdict"),
        )
    ]
    for brief in boundaries:
        quoted = brief.quoted
        error = quoted.error
        known = [error.before, error.after, error.noise_floor] if error else []
        rest = [*(fixed(100 * e, 2) for e in known), *["–"] * (3 - len(known))]
        lead: list[str] = [brief.boundary, *rest, VERDICTS[quoted.verdict]]
        for name, c in quoted.every.items():
            estimate = (_cell(letter(name)), c.estimate, c.interval)
            rows.append((lead[0], *estimate, *lead[1:]))
            lead = [""] * len(lead)
        if not quoted.every:
            rows.append((lead[0], "none", "", "", *lead[1:]))
    return _table(rows, numbers=(4, 6))


def _sources(boundaries: Sequence[Brief]) -> Table:
    """What makes u of each coefficient, the leading sources."""
    rows: list[Sequence[Any]] = [
        ("coefficient", "u", "source", "type", "adds to u", "u if it were known")
    ]
    for brief in boundaries:
        for name, c in brief.quoted.quotable.items():
            lead: list[Any] = [_cell(f"{letter(name)}, {brief.boundary}"), plain(c.u, 2)]
            for line in sorted(c.budget, key=lambda line: line.u_without)[:SOURCES]:
                shown = (plain(line.u, 2), plain(line.u_without, 2))
                rows.append((*lead, titled(line.source), line.kind, *shown))
                lead = ["", ""]
    return _table(rows, numbers=(4, 5))


def _conditions(boundaries: Sequence[Brief]) -> Table:
    """What each headline would be on another condition."""
    rows: list[Sequence[Any]] = [("coefficient", "if", "value", "90 % interval")]
    for brief in boundaries:
        name = brief.quoted.headline
        if not name:
            continue
        c, lead = brief.quoted.coefficients[name], _cell(f"{letter(name)}, {brief.boundary}")
        for doubt in c.doubts:
            value, low, high = (like(x, c.u) for x in (doubt.value, doubt.lo90, doubt.hi90))
            rows.append((lead, _cell(titled(doubt.condition)), value, f"{low} to {high}"))
            lead = ""
    return _table(rows, widths=(None, 0.55 * WIDTH, None, None))


def _cell(text: str) -> Paragraph:
    return Paragraph(_set(text), ParagraphStyle("cell", SMALL, spaceAfter=0))


def _table(
    rows: Sequence[Sequence[Any]],
    numbers: tuple[int, int] | None = None,
    widths: Sequence[float | None] | None = None,
) -> Table:
    """With three rules, as journals set them; the columns `numbers` to the right."""
    rules = [
        ("LINEABOVE", (0, 0), (-1, 0), 0.8, "black"),
        ("LINEBELOW", (0, 0), (-1, 0), 0.4, "black"),
        ("LINEBELOW", (0, -1), (-1, -1), 0.8, "black"),
    ]
    style = [
        ("FONT", (0, 0), (-1, -1), "Serif", 8, 9.6),
        ("VALIGN", (0, 0), (-1, -1), "TOP"),
        ("TOPPADDING", (0, 0), (-1, -1), 0.5),
        ("BOTTOMPADDING", (0, 0), (-1, -1), 1.5),
        *rules,
    ]
    if numbers:
        style.append(("ALIGN", (numbers[0], 0), (numbers[1], -1), "RIGHT"))
    return Table(rows, hAlign="LEFT", style=style, colWidths=widths, repeatRows=1)


def _found(brief: Brief) -> str:
    """A boundary in a paragraph."""
    holds = [titled(c.holds) for c in brief.quoted.quotable.values()][:1]
    parts = [
        f"<b>{brief.boundary.capitalize()}.</b> {_set(brief.verdict)}",
        *(f"The interval {_set(text[:1].lower() + text[1:])}" for text in holds),
        *([f"It leaves out {_set(brief.omits)}."] if brief.omits else []),
        *(f"{_set(letter(name))} is {_set(why)}." for name, why in brief.quoted.refused.items()),
    ]
    for label, text in (
        ("Error", brief.error),
        ("Budget", brief.sources),
        ("Doubts", "; ".join(brief.doubts[:DOUBTS])),
        ("What moves it most", brief.influence),
        ("Next", brief.next),
    ):
        if text:
            parts.append(f"<i>{label}:</i> {_set(text)}.")
    return " ".join(parts)


def _set(text: str) -> str:
    """Plain text as a paragraph's markup: symbols with their index, letters that the font lacks
    from another.
    """
    known = pdfmetrics.getFont("Serif").face.charToGlyph
    shown = "".join(
        escape(c) if ord(c) in known else f'<font name="Other">{escape(c)}</font>'
        for c in text
        if c.isprintable()
    )
    return INDEXED.sub(r'<i>\1</i><sub rise="2" size="6">\2</sub>', shown)


class Space(Flowable):  # type: ignore[misc]  # reportlab has no types
    """Room for a figure at a scale, which notes where it came to stand: page from 0, lower left
    corner in points.
    """

    page: int
    corner: tuple[float, float]

    def __init__(self, drawn: PageObject, scale: float, title: str) -> None:
        super().__init__()
        self.drawn, self.scale, self.title = drawn, scale, title
        box = drawn.mediabox
        self.width, self.height = (scale * float(side) for side in (box.width, box.height))

    def wrap(self, *_: float) -> tuple[float, float]:
        """Its size."""
        return self.width, self.height

    def draw(self) -> None:
        """Nothing yet but a line in the reader's contents."""
        self.page = self.canv.getPageNumber() - 1
        self.corner = self.canv.absolutePosition(0, 0)
        self.canv.bookmarkPage(self.title)
        self.canv.addOutlineEntry(self.title, self.title)


def _figure(figure: Drawn, label: str, placed: list[Space]) -> Flowable:
    """A figure with its caption on one page, as large as it was drawn if that goes."""
    picture, content = figure
    drawn = PdfReader(io.BytesIO(content)).pages[0]
    caption = Paragraph(
        f"<b>{label}. {_set(picture.title)}.</b> {_set(titled(picture.caption))}", SMALL
    )
    _, beneath = caption.wrap(WIDTH, HEIGHT)
    # a heading may stand above, and a hair between
    room = HEIGHT - beneath - 30
    box = drawn.mediabox
    scale = min(1.0, WIDTH / float(box.width), room / float(box.height))
    space = Space(drawn, scale, f"{label}: {picture.title}")
    space.hAlign = "CENTER"
    placed.append(space)
    return KeepTogether([space, Spacer(1, 3), caption, Spacer(1, 8)])


def _with_figures(content: io.BytesIO, placed: Sequence[Space]) -> bytes:
    """The pages with each figure's drawing, no picture of it, where room was left."""
    whole = PdfWriter(clone_from=content)
    for i, figure in enumerate(placed):
        source: Any = figure.drawn
        form = source["/Contents"].get_object().clone(whole)
        form[NameObject("/Type")] = NameObject("/XObject")
        form[NameObject("/Subtype")] = NameObject("/Form")
        form[NameObject("/BBox")] = source.mediabox.clone(whole)
        form[NameObject("/Resources")] = source["/Resources"].clone(whole)
        page: Any = whole.pages[figure.page]
        resources = page["/Resources"].get_object()
        known = resources.setdefault(NameObject("/XObject"), DictionaryObject()).get_object()
        known[NameObject(f"/Figure{i}")] = form.indirect_reference
        (x, y), k = figure.corner, figure.scale
        shown = DecodedStreamObject()
        shown.set_data(f"q {k:.6f} 0 0 {k:.6f} {x:.3f} {y:.3f} cm /Figure{i} Do Q\n".encode())
        if not isinstance(page["/Contents"], ArrayObject):
            page[NameObject("/Contents")] = ArrayObject([page.raw_get("/Contents")])
        page["/Contents"].append(whole._add_object(shown))
    sink = io.BytesIO()
    whole.write(sink)
    return sink.getvalue()
