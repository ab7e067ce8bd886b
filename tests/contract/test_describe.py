"""Tests of what `nearlift describe` prints about declarations."""

import re

import pytest

from nearlift import catalogue
from nearlift.describe import describe
from nearlift.errors import UsageError
from nearlift.nomenclature import SYMBOLS, label, symbol
from nearlift.stages import PRODUCTS


@pytest.mark.parametrize("item", [*catalogue.models(), *catalogue.effects()], ids=lambda d: d.name)
def test_page_says_everything_that_is_declared(item):
    page = describe(item.name)
    assert item.formula in page
    for p in item.parameters:
        assert f"`{p.name}`" in page
        assert p.meaning in page
    for doubt in item.source.doubts:
        assert doubt in page
    for check in item.checks:
        assert f"{check.expected:.7g}" in page


def test_listing_names_everything():
    text = describe()
    for item in (*catalogue.models(), *catalogue.effects(), *SYMBOLS):
        assert f"`{item.name}`" in text
    for product in PRODUCTS:
        assert product.file in text


def test_product_is_found_by_file_and_by_name():
    assert describe("lift.parquet") == describe("lift")
    assert "`delta_L`" in describe("lift")


def test_unknown_name_proposes_the_nearest():
    known = (
        r"there is no model, effect, product or symbol 'sanches_cuevas'(.|\n)*did you mean sanchez"
    )
    with pytest.raises(UsageError, match=known):
        describe("sanches_cuevas")
    with pytest.raises(UsageError, match=r"'nosuch'\n  `nearlift describe` lists them$"):
        describe("nosuch")


def test_names_of_all_kinds_are_distinct():
    names = [d.name for d in (*catalogue.models(), *catalogue.effects(), *PRODUCTS, *SYMBOLS)]
    assert sorted(names) == sorted(set(names))


def test_symbols():
    assert symbol("z_hat").paper_symbol == r"\hat{z}"
    assert symbol("u_lift_N").unit == "N"
    with pytest.raises(UsageError, match=r"there is no symbol 'z_hatt'\n  did you mean z_hat"):
        symbol("z_hatt")
    with pytest.raises(UsageError, match="there is no symbol 'u_nothing'"):
        symbol("u_nothing")
    assert label("z_hat") == r"$\hat{z}$"
    assert label("z_m") == "$z$ (m)"
    assert label("delta_L", "%") == r"$\Delta L$ (%)"


def test_units_are_in_names():
    units = {"m", "N", "V", "A", "W", "K", "Pa", "Hz", "rad", "s", "kg"}
    for s in SYMBOLS:
        assert s.unit not in units or s.name.endswith(f"_{s.unit}"), f"{s.name} has {s.unit}"


def test_tables_are_whole():
    declared = [d.name for d in (*catalogue.models(), *catalogue.effects())]
    for name in (None, *declared, *(p.file for p in PRODUCTS)):
        for block in re.findall(r"(?:^\|.*\n?)+", describe(name), flags=re.M):
            counts = {len(re.findall(r"(?<!\\)\|", line)) for line in block.strip().splitlines()}
            assert len(counts) == 1, f"{name}: rows of different length"
