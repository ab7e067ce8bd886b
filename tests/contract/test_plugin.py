"""A package of someone else's adds a model by entry point, and is refused by its name when it is
broken. `test_examples` installs real packages; here one is a module and what pip writes of it.
"""

import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from nearlift.declare import Effect, LiftModel
from nearlift.errors import DeclarationError
from nearlift.models import MODELS
from nearlift.plugins import digests, gather

MODEL = """
import numpy as np
from nearlift.declare import Check, LiftModel, Parameter, Source, uniform

def evaluate(z_hat, /, *, k):
    return 1 + k * np.exp(-np.square(z_hat))

MODEL = LiftModel(
    name="{name}", title="Bell", formula="1 + k e^{{-z^2}}", evaluate=evaluate, boundary="ground",
    parameters=(Parameter(name="k", unit="1", value=0.5, bounds=(0, 2), prior=uniform(0, 2), meaning="gain at contact"),),
    source=Source(citation="nobody", doubts=("all of it",)),
    checks=(Check(x=0.0, expected={expected}, quoted_by="nobody"),),
)
NOT_A_MODEL = 3
"""


def install(
    site: Path, package: str, body: str, attribute: str = "MODEL", group: str = "nearlift.models"
) -> None:
    """Put a package that declares one thing into a folder."""
    module = package.replace("-", "_")
    (site / f"{module}.py").write_text(body)
    known = site / f"{module}-1.0.dist-info"
    known.mkdir()
    (known / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    (known / "entry_points.txt").write_text(f"[{group}]\n{module} = {module}:{attribute}\n")


def python(site: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(site)}
    return subprocess.run(
        [sys.executable, *arguments], env=environment, capture_output=True, text=True, timeout=300
    )


def test_a_model_is_offered_and_described_after_the_built_in_ones(tmp_path):
    """A broken package breaks nothing until the catalogue is asked."""
    install(tmp_path, "lift-bell", MODEL.format(name="bell", expected=1.5))
    code = """
from nearlift import catalogue
from nearlift.describe import describe
from nearlift.run.engine import versions
names = [m.name for m in catalogue.models("ground")]
print(names.index("power_law") < names.index("bell"))
print("bell" in catalogue.default_rivals("ground", 4, {}))
print("gain at contact" in describe("bell"))
print(versions()["lift-bell"] == "1.0")
"""
    shown = python(tmp_path, "-c", code)
    assert shown.stdout.split() == ["True"] * 4, shown.stderr
    install(tmp_path, "lift-lazy", "raise RuntimeError('loaded')")
    asked = "import nearlift.catalogue as c, nearlift.describe; print('imported'); c.models()"
    shown = python(tmp_path, "-c", asked)
    assert shown.stdout == "imported\n"
    assert "package lift-lazy: its entry point" in shown.stderr


@pytest.mark.parametrize(
    ("package", "body", "attribute", "words"),
    [
        ("lift-import", "import not_there", "MODEL", "breaks: ModuleNotFoundError: .*'not_there'"),
        ("lift-absent", MODEL.format(name="a", expected=1.5), "NONE", "breaks: AttributeError"),
        ("lift-number", MODEL.format(name="b", expected=1.5), "NOT_A_MODEL", "type int, not Lift"),
        ("lift-wrong", MODEL.format(name="c", expected=1.7), "MODEL", "c: gives 1.5 at x = 0.0"),
        (
            "lift-taken",
            MODEL.format(name="hayden", expected=1.5),
            "MODEL",
            "declares 'hayden', a name that nearlift declares already",
        ),
    ],
)
def test_a_broken_package_is_refused_by_its_name(
    tmp_path, monkeypatch, package, body, attribute, words
):
    install(tmp_path, package, body, attribute)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(DeclarationError, match=f"package {package}: .*{words}"):
        gather("nearlift.models", LiftModel, MODELS)


def test_two_packages_with_one_name_are_refused(tmp_path, monkeypatch):
    for package in ("lift-first", "lift-second"):
        install(tmp_path, package, MODEL.format(name="twin", expected=1.5))
    monkeypatch.syspath_prepend(tmp_path)
    words = "package lift-second: declares 'twin', a name that lift-first declares already"
    with pytest.raises(DeclarationError, match=words):
        gather("nearlift.models", LiftModel, MODELS)


def test_effects_have_their_own_group(tmp_path, monkeypatch):
    body = MODEL.format(name="bell", expected=1.5)
    install(tmp_path, "lift-effect", body, group="nearlift.effects")
    monkeypatch.syspath_prepend(tmp_path)
    words = "entry point 'lift_effect' in nearlift.effects is of type LiftModel, not Effect"
    with pytest.raises(DeclarationError, match=words):
        gather("nearlift.effects", Effect, ())


def test_a_parameter_with_the_name_of_an_effects_is_refused(tmp_path):
    """The search could not add the effect to the model, and would not identify it."""
    body = (
        MODEL.format(name="bell", expected=1.5).replace("*, k", "*, gain").replace("k *", "gain *")
    )
    install(tmp_path, "lift-bell", body.replace('name="k"', 'name="gain"'))
    shown = python(tmp_path, "-c", "import nearlift.catalogue as c; c.models()")
    assert "model bell: its parameter 'gain' is also one of effect session_gain" in (shown.stderr)


def test_the_code_of_a_package_decides_whether_products_are_stale(tmp_path, monkeypatch):
    """A module, and each file of a folder; neither is imported."""
    install(tmp_path, "lift-bell", "raise RuntimeError('imported')")
    install(tmp_path, "lift-folder", "")
    (tmp_path / "lift_folder.py").unlink()
    (tmp_path / "lift_folder").mkdir()
    table = tmp_path / "lift_folder" / "table.csv"
    for file in (table, table.with_name("__init__.py")):
        file.write_text("1")
    monkeypatch.syspath_prepend(tmp_path)

    def now() -> dict[str, str]:
        importlib.invalidate_caches()
        digests.cache_clear()
        return {name: digest for name, digest in digests().items() if name.startswith("lift-")}

    before = now()
    assert set(before) == {"lift-bell", "lift-folder"}
    (tmp_path / "lift_bell.py").write_text("raise RuntimeError('imported again')")
    assert {n for n, digest in now().items() if digest != before[n]} == {"lift-bell"}
    table.write_text("2")
    assert {n for n, digest in now().items() if digest != before[n]} == {*before}
    monkeypatch.undo()
    digests.cache_clear()
