"""Every remedy that is a command of nearlift, run in the state that it is proposed in."""

from __future__ import annotations

import ast
import json
import re
import shlex
from collections.abc import Callable
from pathlib import Path

import pytest

import nearlift as package
from nearlift.fit.estimator import NOT_LOOKED_AT

from . import small_run, written
from .small_run import nearlift

SOURCE = Path(package.__file__).parent
FORCE = [0.1 + 0.01 * i for i in range(60)]
#: What a user puts where a remedy has a word in capitals.
Stands = dict[str, str]


def proposed() -> set[str]:
    """Every command between back quotes in a text of the source that is no docstring."""
    found: set[str] = set()
    for path in SOURCE.rglob("*.py"):
        tree = ast.parse(path.read_text())
        said = {
            id(node.body[0].value)
            for node in ast.walk(tree)
            if isinstance(node, ast.Module | ast.FunctionDef | ast.ClassDef)
            and node.body
            and isinstance(node.body[0], ast.Expr)
        }
        inner = {
            id(part) for n in ast.walk(tree) if isinstance(n, ast.JoinedStr) for part in n.values
        }
        for node in ast.walk(tree):
            if isinstance(node, ast.JoinedStr):
                text = "".join(
                    str(v.value) if isinstance(v, ast.Constant) else "FILE" for v in node.values
                )
            elif isinstance(node, ast.Constant) and id(node) not in said | inner:
                text = str(node.value)
            else:
                continue
            found |= set(re.findall(r"`(nearlift [^`]+)`", text))
    return found


def nothing(root: Path) -> tuple[list[object], Stands]:
    return ["run", root / "raw"], {"DIR": str(root / "raw")}


def files_without_manifest(root: Path) -> tuple[list[object], Stands]:
    folder = small_run.write_means(root / "raw", 24, quick=True)
    (folder / "campaign.toml").unlink()
    return ["run", folder], {"DIR": str(folder), "FILES": str(folder)}


def a_key_is_missing(root: Path) -> tuple[list[object], Stands]:
    folder = small_run.write_means(root / "raw", 24, quick=True)
    path = folder / "campaign.toml"
    path.write_text(path.read_text().replace(', mass = "27 g"', ""))
    return ["ingest", folder, "--out", root], {"DIR": str(root / "template")}


def no_such_symbol(root: Path) -> tuple[list[object], Stands]:
    return ["describe", "u_nothing_like_it"], {}


def no_such_model(root: Path) -> tuple[list[object], Stands]:
    folder = small_run.write_means(root / "raw", 24)
    path = folder / "campaign.toml"
    path.write_text(path.read_text() + '\n[fit.ground]\nbase = "hsiao_chirarattananon"\n')
    return ["run", folder, "--out", root], {}


def not_ingested(root: Path) -> tuple[list[object], Stands]:
    folder = small_run.write_means(root / "raw", 24, quick=True)
    return ["fit", folder, "--out", root], {"CAMPAIGN": f"{folder} --out {root}"}


def fitted(root: Path, folder: Path | None = None) -> Path:
    folder = folder or small_run.write_means(root / "raw", 24, quick=True)
    for stage in ("ingest", "reduce", "fit"):
        assert nearlift(stage, folder, "--out", root, "-q").exit_code == 0
    return folder


def not_fitted(root: Path) -> tuple[list[object], Stands]:
    folder = small_run.write_means(root / "raw", 24, quick=True)
    return ["compare", "--out", root], {"CAMPAIGN": f"{folder} --out {root}"}


def one_of_them_not_fitted(root: Path) -> tuple[list[object], Stands]:
    folder = small_run.write_means(root / "raw", 24, quick=True)
    return ["compare", "means", "--out", root], {"CAMPAIGN": f"{folder} --out {root}"}


def another_format(reader: str) -> Callable[[Path], tuple[list[object], Stands]]:
    def state(root: Path) -> tuple[list[object], Stands]:
        folder = small_run.write(root / "raw")
        path = folder / "campaign.toml"
        path.write_text(path.read_text().replace('reader = "csv"', f'reader = "{reader}"'))
        record = sorted((folder / "trials").iterdir())[0]
        return ["ingest", folder, "--out", root], {"FILE": str(record)}

    return state


def a_velocity_grid(root: Path) -> tuple[list[object], Stands]:
    rows = "".join(f"{16 * i} {16 * j} 1 -2 {30 + i}\n" for j in range(1, 5) for i in range(1, 6))
    path = written.put(root, "a.txt", rows.encode())
    return ["new", root / "raw", "--from", path], {"FILE": str(path)}


TABLE = b"distance_cm,pwm,lift_N\n5,1100,2.5\n9,1100,2.4\n20,1200,2.3\n"


def a_table_of_means(root: Path) -> tuple[list[object], Stands]:
    path = written.put(root, "table.csv", TABLE)
    return ["inspect", path], {"DIR": str(root / "raw"), "FILE": str(path)}


def a_folder_of_records(root: Path) -> tuple[list[object], Stands]:
    for name in ("r1", "r2"):
        written.put(root, f"logs/{name}.lvm", written.lvm(FORCE))
    folder = root / "logs"
    return ["inspect", folder], {"DIR": str(root / "raw"), "FOLDER": str(folder)}


def a_table_of_trials(root: Path) -> tuple[list[object], Stands]:
    path = written.put(root, "log book.csv", b"file,distance_cm,pwm\nr1,5,1100\nr2,9,1100\n")
    for name in ("r1", "r2"):
        written.put(root, f"logs/{name}.lvm", written.lvm(FORCE))
    stands = {"DIR": str(root / "raw"), "FILE": shlex.quote(str(path))}
    return ["inspect", path], stands | {"RECORDS": str(root / "logs")}


#: Each proposed command, and a call of nearlift that proposes it.
STATES: dict[str, list[Callable[[Path], tuple[list[object], Stands]]]] = {
    "nearlift new DIR": [nothing, a_key_is_missing],
    "nearlift new DIR --from FILES": [files_without_manifest],
    "nearlift new DIR --from FOLDER": [a_folder_of_records],
    "nearlift new DIR --from FILE": [a_table_of_means, a_table_of_trials],
    "nearlift describe": [no_such_symbol, no_such_model],
    "nearlift run --dry-run CAMPAIGN": [not_ingested],
    "nearlift run CAMPAIGN": [not_fitted, one_of_them_not_fitted],
    "nearlift inspect FILE": [
        another_format("lvm"),
        another_format("rcbenchmark"),
        a_velocity_grid,
    ],
}
#: Those that are no remedies but stand in a comment of a manifest; what a fit alone and a sweep
#: propose, which have tests of their own.
ELSEWHERE = {
    "nearlift design",
    "nearlift diagnose",
    "nearlift next",
    "nearlift next --for",
    "nearlift inspect --cuts CAMPAIGN",
}


def test_every_proposed_command_is_tried_here():
    assert proposed() == STATES.keys() | ELSEWHERE


@pytest.mark.parametrize(
    ("command", "state"), [(c, s) for c, states in STATES.items() for s in states]
)
@pytest.mark.usefixtures("plain_pictures")
@pytest.mark.nightly
def test_a_remedy_works_where_it_is_proposed(tmp_path, command, state):
    words, stands = state(tmp_path)
    told = nearlift(*words).output
    proposals = re.findall(r"`(nearlift [^`]+)`", told)
    pattern = re.escape(command).replace("FILE", "(RECORDS )?FILE")
    for name, value in stands.items():
        pattern = pattern.replace(name, f"({name}|{re.escape(value)})")
    found = [text for text in proposals if re.fullmatch(pattern, text)]
    assert found, f"{command} is not proposed:\n{told}"
    said = found[0]
    for name, value in stands.items():
        said = re.sub(rf"\b{name}\b", lambda _, value=value: value, said)
    answer = nearlift(*shlex.split(said)[1:])
    assert answer.exit_code == 0, f"{said}\n{answer.output}"
    if words[0] in ("run", "diagnose", "compare") and command != "nearlift describe":
        # it leads on: what was refused is refused no more, or for another reason
        assert nearlift(*words).output != told


def test_what_a_fit_alone_proposes_is_done_by_diagnose(tmp_path):
    folder = fitted(tmp_path)
    results = tmp_path / "processed" / "means" / "results.json"
    assert json.loads(results.read_text())["boundaries"]["ground"]["reason"] == NOT_LOOKED_AT
    assert nearlift("diagnose", folder, "--out", tmp_path, "-q").exit_code == 0
    assert json.loads(results.read_text())["boundaries"]["ground"]["reason"] != NOT_LOOKED_AT


def test_what_a_reading_lacks_can_be_added_as_it_is_told(tmp_path):
    """One option at a time, until the only thing that is missing is the campaign."""
    words: list[str] = ["detect", str(tmp_path / "nowhere"), "--ratio", "1.1"]
    for _ in range(2):
        refused = nearlift(*words)
        assert refused.exit_code == 2
        added = re.search(r"\n  add (--.*)\n", refused.stderr)
        assert added, refused.stderr
        words += shlex.split(added[1])
    assert "holds no campaign.toml" in nearlift(*words).stderr
