"""The language of what a user reads: plain words, short sentences, one place that makes them."""

from __future__ import annotations

import ast
import html
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import nearlift
from nearlift import catalogue
from nearlift.reduction import quality as quality_codes
from nearlift.report import phrases, sources, words
from nearlift.results.diagnosis import ExplanationProbability
from nearlift.results.quotation import IdentifiedSize

PACKAGE = Path(nearlift.__file__).parent
#: Words that have a plainer one.
AVOIDED = re.compile(
    r"\b(stands?|stood|beside|told|tells|nobody|foretell\w*|foretold|foresight|mend(s|ed|ing)?|"
    r"grave|graver|gravest|anew|leans? on|rests on|hangs? on|strays?|goes by|goes with|unseen|"
    r"taken out|cannot tell|cannot part|too small to be seen|by chance alone|noise alone|"
    r"next to nothing|what a trial holds|what repeats do|declared errors?|trade places|worth)\b",
    re.IGNORECASE,
)
#: Most words of a sentence.
LONGEST = 25
#: No word of a sentence: numbers, symbols, formulas, names of files and columns.
NO_WORD = re.compile(
    r"[^A-Za-z]*|.*[_/=^{}<>|\\@].*|.*\.(json|csv|txt|md|tex|pdf|png|bib|toml|parquet).*"
)
BLOCK = re.compile(
    r"<(p|li|dd|figcaption|summary|h[1-6]|caption|th|td)\b[^>]*>(.*?)</\1>", re.DOTALL
)
HEADLESS = re.compile(r"(The same|The rest|As|Of|That|Those|What|Which|When|Where|With|Beside)\b")


def sentences(text: str) -> list[str]:
    """The sentences of a text; a semicolon and a colon join two."""
    return [s for s in re.split(r"(?<=[.!?])\s+", " ".join(text.split())) if s]


def length(sentence: str) -> int:
    """Words of a sentence, formulas, numbers and file names aside."""
    return sum(
        not NO_WORD.fullmatch(w) for w in sentence.replace("\N{NO-BREAK SPACE}", " ").split()
    )


def blocks(page: str) -> list[str]:
    """The texts of a page: paragraphs, list items, captions and cells."""
    body = re.sub(r"<(script|style|svg)\b.*?</\1>", "", page, flags=re.DOTALL)
    return [html.unescape(re.sub(r"<[^>]+>", "", text)) for _, text in BLOCK.findall(body)]


@pytest.fixture(scope="module")
def read(demo: Path) -> list[str]:
    """Everything that the demo's reader reads: page, summary and methods."""
    folder = demo / "reports/demo"
    summary = (folder / "summary.txt").read_text(encoding="utf8")
    parts = re.split(r"\n\n|\n {4}(?! )", summary)
    methods = (folder / "methods.md").read_text(encoding="utf8").split("\n\n")
    return [*blocks((folder / "index.html").read_text(encoding="utf8")), *parts, *methods]


def test_the_report_of_the_demo_has_no_word_that_has_a_plainer_one(read):
    found = {m[0]: text[:90] for text in read for m in [AVOIDED.search(text)] if m}
    assert not found


def test_no_sentence_of_the_report_is_longer_than_it_may_be(read):
    long = [s for text in read for s in sentences(text) if length(s) > LONGEST]
    assert not long


@pytest.mark.parametrize("room", ["report", "results"])
def test_docstrings_have_a_head_and_messages_plain_words(room):
    wrong = []
    for path in sorted((PACKAGE / room).rglob("*.py")):
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf8"))))
        owners = [n for n in nodes if isinstance(n, ast.Module | ast.ClassDef | ast.FunctionDef)]
        documents = {ast.get_docstring(n, clean=False) for n in owners} - {None}
        texts = {n.value for n in nodes if isinstance(n, ast.Constant) and isinstance(n.value, str)}
        wrong += [(path.name, d[:60]) for d in documents if HEADLESS.match(d)]
        spoken = (t for t in texts - documents if " " in t)
        wrong += [(path.name, t[:60]) for t in spoken if AVOIDED.search(t)]
    assert not wrong


def test_titles_of_effects_can_be_subjects_of_a_sentence():
    for effect in catalogue.effects():
        assert len(effect.title.split()) <= 3, effect.title
        assert not re.match(r"(What|The|A|Of)\b", effect.title)
        assert " of " not in effect.title


SIZES = {
    ("supply_sag", "sag_exponent", 2.028, 0.0745, "exponent of supply voltage"): (
        "lift scales as voltage^2.03 (90 %: 1.95 to 2.10)"
    ),
    ("gain_drift", "drift", 0.0498, 0.003, "fraction of lift, first to last trial"): (
        "drift 4.98 % of lift, first to last trial (90 %: 4.68 to 5.28)"
    ),
    ("height_offset", "offset_m", 0.0005, 0.0001, "m"): "offset 0.50 mm (90 %: 0.40 to 0.60)",
    ("zero_temperature", "zero_N_per_K", 0.0015, 0.0003, "N/K"): (
        "zero 1.50 mN/K (90 %: 1.20 to 1.80)"
    ),
    ("near_wall_saturation", "gap_hat2", 0.125, 0.055, "square rotor radii"): (
        "the gain of lift saturates below ẑ = 0.35, 8.1 mm (90 %: 6.1 to 9.8)"
    ),
}


@pytest.mark.parametrize(("size", "text"), SIZES.items(), ids=[k[0] for k in SIZES])
def test_a_size_is_said_with_its_unit_and_its_part_of_lift(size, text):
    effect, parameter, value, half, unit = size
    size = IdentifiedSize(
        effect=effect,
        parameter=parameter,
        value=value,
        lo90=value - half,
        hi90=value + half,
        unit=unit,
        lift_percent=4.93,
    )
    said = phrases.sizes(SimpleNamespace(sizes=(size,), effects=(effect,)), 0.023)
    assert said == f"{text}. Over the trials it changes lift by 4.9 %"


def observed(*z_hat: float) -> SimpleNamespace:
    return SimpleNamespace(z_hat=np.array(z_hat), covariates={})


@pytest.mark.parametrize(
    ("z_hat", "asked"),
    [
        ((2.0, 4.0), "stations below z_hat = 1 and beyond 5"),
        ((0.5, 4.0), "stations beyond z_hat = 5"),
        ((2.0, 24.0), "stations below z_hat = 1"),
        ((0.5, 24.0, np.inf), ""),
    ],
)
def test_no_station_is_asked_for_that_is_there(z_hat, asked):
    effect = catalogue.effect("image_strength")
    assert sources.missing_for(effect, observed(*z_hat)) == asked


def test_of_a_list_only_the_stations_that_are_there_go():
    effect = catalogue.effect("height_offset")
    assert sources.missing_for(effect, observed(1.0, 2.0)) == effect.separated_by
    assert sources.missing_for(effect, observed(1.0, 9.0)) == "a touch-off with a gauge"


@pytest.mark.parametrize(
    ("value", "warned"), [(2.0, False), (-0.4, False), (-1.4, True), (8, True)]
)
def test_a_coefficient_beyond_its_usual_values_is_warned_of(value, warned):
    K_b = SimpleNamespace(value=value, lo90=value - 0.5, hi90=value + 0.5)
    quoted = SimpleNamespace(base_model="sanchez_cuevas", coefficients={"K_b": K_b})
    said = phrases.implausible(quoted)
    assert len(said) == warned
    if said:
        assert f"{value:g} lies beyond its usual values, 0 to 6" in said[0].replace("−", "-")
        assert length(said[0]) <= LONGEST


def test_an_effect_that_is_the_coefficient_is_no_doubt():
    own = SimpleNamespace(effect="image_strength", share_visible=1e-9)
    assert sources.is_the_coefficient(own)
    assert not sources.is_the_coefficient(
        SimpleNamespace(effect="image_strength", share_visible=0.1)
    )
    # an error of the bench shifts the coefficient, however well that absorbs it
    assert not sources.is_the_coefficient(SimpleNamespace(effect="height_scale", share_visible=0.0))


@pytest.mark.parametrize(
    ("n_removed", "said"),
    [
        (None, ""),
        ([0.0, 9.0, 3.0], "; 12 impossible readings in 2 trials were left out"),
        ([0.0, 0.0, 1.0], "; 1 impossible reading in 1 trial was left out"),
    ],
)
def test_what_was_removed_from_records_is_counted(n_removed, said):
    table = {"quality": np.array(["SATURATED", "", ""], dtype=object)}
    if n_removed:
        table["n_removed"] = np.array(n_removed)
    left_out = f"1 left out: {quality_codes.CODES['SATURATED']} (1)"
    assert words.removed(SimpleNamespace(table=lambda _: table)) == left_out + said


def weighed(*likely: tuple[tuple[str, ...], float, str]) -> SimpleNamespace:
    """Diagnosis with these explanations: effects, probability, covariate of nameless structure."""
    listed = [
        ExplanationProbability(effects=e, probability=p, nameless=n or None) for e, p, n in likely
    ]
    return SimpleNamespace(probabilities=listed)


PAIR = (("supply_sag",), 0.48, ""), (("session_gain", "zero_drift"), 0.39, "")
NAMELESS = (("supply_sag",), 0.4, ""), ((), 0.25, ""), ((), 0.35, "session")


@pytest.mark.parametrize(
    ("probability", "likely", "text"),
    [
        (None, PAIR, "supply sag"),
        (0.6, PAIR, "supply sag"),
        (
            *(0.48, (*PAIR, ((), 0.04, ""), (("warm_up",), 0.03, ""))),
            "one of: supply sag 48 %, session gain with zero drift 39 %, other 13 %",
        ),
        (
            *(0.4, NAMELESS),
            "one of: supply sag 40 %, unexplained structure along session 35 %, no effect 25 %",
        ),
    ],
)
def test_an_effect_is_named_alone_where_it_is_probable(probability, likely, text):
    quoted = SimpleNamespace(probability=probability, effects=("supply_sag",), verdict="effect")
    assert phrases.explanation(quoted, weighed(*likely)) == text


@pytest.mark.parametrize(
    ("probability", "forms", "text"),
    [
        (0.9, {"plate_edge": "Gaussian"}, " (plate edge in its Gaussian form)"),
        (0.5, {"plate_edge": "Gaussian"}, ""),
        (0.9, None, ""),
    ],
)
def test_the_form_is_printed_of_an_effect_named_alone(probability, forms, text):
    assert phrases.forms(SimpleNamespace(probability=probability, forms=forms)) == text
