"""A hostile manifest is refused within a second, in few words."""

import re
from pathlib import Path

import pytest
from tests.unit.test_bounds import run

from nearlift.campaign import manifest as campaign

GOOD = Path(__file__).with_name("good.toml").read_text(encoding="utf-8")
MANY = campaign.MOST_BYTES

LOAD = """
from pathlib import Path
from nearlift.campaign import manifest as campaign
from nearlift.errors import ManifestError
def answer(name, folder):
    try:
        campaign.load(Path(folder))
    except ManifestError as refusal:
        return str(refusal)
"""
HOSTILE = {
    "too_large": ("a" * MANY + "= 1", "has more than 524288 bytes"),
    "dotted_key": ("a." * 20_000 + "a = 1", "line 1: has a key of more than 8 parts"),
    "quoted_dotted_key": ('"a" . ' * 20_000 + "a = 1", "has a key of more than 8 parts"),
    "dotted_table": ("# one\n[" + "a." * 20_000 + "a]\n", "line 2: has a key of more than 8"),
    "brackets": ("a = " + "[" * 50_000, "is not valid TOML"),
    "braces": ("a = " + "{a=" * 50_000, "is not valid TOML"),
    "digits": ("a = " + "1" * 10_000, "is not valid TOML"),
    "hexadecimal_digits": ("a = 0x" + "f" * 10_000, "a: a whole number of TOML has at most 64"),
    "whole_number": (
        GOOD.replace("rotors = 4", "rotors = 9223372036854775808"),
        "vehicle.rotors: a whole number of TOML has at most 64 bits",
    ),
    "unknown_keys": ("".join(f"a{i}=1\n" for i in range(50_000)), r"and 49\d\d\d more"),
    "lines_of_deep_keys": (
        "".join(f"a{i}.b.c.d.e.f.g=1\n" for i in range(25_000)),
        r"and 24\d\d\d more",
    ),
    "long_key": ("a" * (MANY - 10) + "=1", "unknown key"),
    "long_text": (
        GOOD.replace("23 mm", "2" * (MANY - len(GOOD) - 9) + "x"),
        r"rotor_radius: .* \.\.\. ",
    ),
    "blanks_in_a_quantity": (
        GOOD.replace("23 mm", "23 m" + " " * 500_000 + "m"),
        "rotor_radius: unknown unit",
    ),
    "escaped_quotes": ('a = """' + '\\"""' * 100_000, "is not valid TOML"),
    "quotes": ("a = '" + "'\"" * 200_000, "is not valid TOML"),
    "filled_in": ("a = [" + '"FILL IN",' * 40_000 + "]", "and 39950 more"),
    "power_tower": (
        GOOD.replace('unit = "mN"', 'unit = "mN**9**9**9"'),
        "unknown unit 'mN\\*\\*9\\*\\*9\\*\\*9'",
    ),
    "power_of_powers": (
        GOOD.replace('unit = "mN"', 'unit = "((((mN^99)^99)^99)^99)"'),
        "unknown unit",
    ),
}


@pytest.fixture(scope="module")
def refusals(tmp_path_factory) -> dict[str, str]:
    folders = {name: tmp_path_factory.mktemp(name) for name in HOSTILE}
    for name, folder in folders.items():
        (folder / "campaign.toml").write_text(HOSTILE[name][0], encoding="utf-8")
    return run(LOAD, *((name, str(folder)) for name, folder in folders.items()))


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_manifest_is_refused_at_once_and_in_few_words(refusals, name):
    assert "hung" not in refusals, refusals["hung"]
    assert re.search(HOSTILE[name][1], refusals[name]), refusals[name][:2000]
    assert len(refusals[name]) < 30_000


def test_a_byte_order_mark_is_no_fault(tmp_path):
    (tmp_path / "campaign.toml").write_text(GOOD, encoding="utf-8-sig")
    assert campaign.load(tmp_path).vehicle.rotors == 4


@pytest.mark.parametrize("text", ["a.b.c.d.e.f.g.h = 1", f'a = "{"." * 1000}"', "a = [1.5, 2.5]"])
def test_a_key_of_eight_parts_and_dots_in_texts_are_no_fault(text):
    assert "a" in campaign.loads(text.encode(), "it")
