"""A package of someone else's adds a model by entry point, and is refused by its name when it is
broken.

Each case is a real package: built by its own backend, installed without an index into a folder of
its own, and seen by a fresh interpreter.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

PYPROJECT = """
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"
[project]
name = "{package}"
version = "1.0"
[project.entry-points."{group}"]
{entry} = "{module}:{attribute}"
[tool.hatch.build.targets.wheel]
packages = ["{module}"]
"""

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
    folder: Path, package: str, body: str, attribute: str = "MODEL", group: str = "nearlift.models"
) -> Path:
    """Build and install a package that declares one thing; returns the folder to put on
    the path.
    """
    module = package.replace("-", "_")
    project = folder / "source" / package
    (project / module).mkdir(parents=True)
    (project / module / "__init__.py").write_text(body)
    (project / "pyproject.toml").write_text(
        PYPROJECT.format(
            package=package, module=module, attribute=attribute, group=group, entry=module
        )
    )
    target = folder / "site"
    command = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--no-index",
        "--no-build-isolation",
        "--no-deps",
        "--disable-pip-version-check",
    ]
    subprocess.run(
        [*command, "--target", str(target), str(project)],
        check=True,
        capture_output=True,
        timeout=120,
    )
    return target


def python(site: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(site)}
    return subprocess.run(
        [sys.executable, *arguments], env=environment, capture_output=True, text=True, timeout=300
    )


def ask(
    site: Path, expression: str = "[m.name for m in catalogue.models('ground')]"
) -> subprocess.CompletedProcess[str]:
    return python(site, "-c", f"from nearlift import catalogue; print({expression})")


@pytest.fixture(scope="module")
def bell(tmp_path_factory) -> Path:
    return install(
        tmp_path_factory.mktemp("bell"), "lift-bell", MODEL.format(name="bell", expected=1.5)
    )


def test_model_of_a_package_is_in_the_catalogue_after_the_built_in_ones(bell):
    out = ask(bell)
    assert out.returncode == 0, out.stderr
    names = names_in(out.stdout)
    assert names[-1] == "bell"
    assert names[0] == "sanchez_cuevas"


def test_it_is_described_and_offered_as_a_rival(bell):
    out = python(bell, "-c", "from nearlift.describe import describe; print(describe('bell'))")
    assert "gain at contact" in out.stdout
    assert "bell" in ask(bell, "catalogue.default_rivals('ground', 4, {})").stdout


def test_it_stands_in_no_generated_page(bell):
    out = python(
        bell,
        "-c",
        "from nearlift.describe import reference_pages; print('models/bell.md' in"
        " reference_pages())",
    )
    assert out.stdout.strip() == "False"


def test_it_passes_the_same_contract_as_the_built_in_ones(bell):
    out = python(
        bell,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        str(Path(__file__).with_name("test_declarations.py")),
        "-k",
        "bell",
    )
    assert out.returncode == 0, out.stdout[-3000:]
    assert "passed" in out.stdout


@pytest.mark.parametrize(
    ("package", "body", "attribute", "told"),
    [
        (
            "lift-import",
            "import a_module_that_is_not_there",
            "MODEL",
            "breaks: ModuleNotFoundError: No module named 'a_module_that_is_not_there'",
        ),
        (
            "lift-absent",
            MODEL.format(name="absent", expected=1.5),
            "NO_SUCH",
            "breaks: AttributeError",
        ),
        (
            "lift-number",
            MODEL.format(name="number", expected=1.5),
            "NOT_A_MODEL",
            "is of type int, not LiftModel",
        ),
        (
            "lift-wrong",
            MODEL.format(name="wrong", expected=1.7),
            "MODEL",
            "breaks: DeclarationError: declaration wrong: gives 1.5 at 0.0",
        ),
        (
            "lift-taken",
            MODEL.format(name="hayden", expected=1.5),
            "MODEL",
            "declares 'hayden', a name that nearlift declares already",
        ),
    ],
)
def test_broken_package_is_refused_by_its_name(tmp_path, package, body, attribute, told):
    out = ask(install(tmp_path, package, body, attribute))
    assert out.returncode != 0
    assert f"package {package}: " in out.stderr
    assert told in out.stderr


def test_two_packages_with_one_name_are_refused(tmp_path):
    install(tmp_path, "lift-first", MODEL.format(name="twin", expected=1.5))
    out = ask(install(tmp_path, "lift-second", MODEL.format(name="twin", expected=1.5)))
    assert (
        "package lift-second: declares 'twin', a name that lift-first declares already"
        in out.stderr
    )


def test_broken_package_breaks_nothing_until_the_catalogue_is_asked(tmp_path):
    site = install(tmp_path, "lift-lazy", "raise RuntimeError('loaded')")
    assert python(site, "-c", "import nearlift.catalogue, nearlift.describe").returncode == 0


def test_effects_have_their_own_group(tmp_path):
    out = ask(
        install(
            tmp_path,
            "lift-effect",
            MODEL.format(name="bell", expected=1.5),
            group="nearlift.effects",
        ),
        "catalogue.effects()",
    )
    assert (
        "package lift-effect: its entry point 'lift_effect' in nearlift.effects is of type"
        " LiftModel, not Effect" in out.stderr
    )


def names_in(text: str) -> list[str]:
    import ast

    result = ast.literal_eval(text.strip())
    assert isinstance(result, list)
    return result
