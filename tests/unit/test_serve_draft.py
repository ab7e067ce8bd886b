"""A campaign made on the page: the text is the manifest, a refusal stands at its field, and what is
written is whole and nothing else.
"""

from __future__ import annotations

import os
import re
import signal
import tempfile
import threading
import time
import tomllib
from pathlib import Path
from urllib.parse import quote, urlencode

import pytest

from nearlift.commands import new
from nearlift.errors import NearliftError
from nearlift.manifest import campaign as manifests
from nearlift.serve import draft, manifest_text
from nearlift.serve.bench import ServedWorkspace

from . import small_run
from .small_run import state
from .test_serve import served

pytest.importorskip("starlette", reason="nearlift[serve] is not installed")
with tempfile.TemporaryDirectory() as _folder:
    new.write_template(Path(_folder, "rig"))
    TEMPLATE = Path(_folder, "rig", "campaign.toml").read_text()


def leaves(text):
    return dict(manifests.leaves(tomllib.loads(text)))


def test_every_value_of_the_template_is_found_in_its_place():
    spans = manifest_text.spans(TEMPLATE)
    for key, value in leaves(TEMPLATE).items():
        begin, end = spans[key]
        assert tomllib.loads(f"x = {TEMPLATE[begin:end]}")["x"] == value


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("vehicle.mass", "27 g"),
        ("vehicle.rotors", "4"),
        ("vehicle.name", 'a # of "quotes" and \\ ] }'),
        ("vehicle.contact.ground", "12 mm"),
        ("records.force.column", "Kraft, y"),
        ("records.force.sign", "-1"),
        ("load_cell.tare", "0.5 s"),
    ],
)
def test_a_field_sets_its_value_and_nothing_else(key, value):
    made = manifest_text.with_value(TEMPLATE, key, value)
    before, after = leaves(TEMPLATE), leaves(made)
    assert {k for k in before | after if before.get(k) != after.get(k)} == {key}
    assert str(after[key]) == value
    assert re.findall("#.*", made)[-3:] == re.findall("#.*", TEMPLATE)[-3:]


def test_an_emptied_line_goes_and_an_unknown_key_is_refused():
    assert "rig.arena" not in leaves(manifest_text.with_value(TEMPLATE, "rig.arena", ""))
    with pytest.raises(NearliftError, match="stands nowhere in the text"):
        manifest_text.with_value(TEMPLATE, "rig.colour", "red")


def test_spans_see_tables_in_arrays_and_long_values():
    text = (
        '[a]\nx = [1, # one\n 2]\ny = """\n[b]\nz = 1\n"""\n[[c]]\nk = "1"\n[[c]]\nk = "2"  # r\n'
    )
    spans = manifest_text.spans(text)
    assert {k: text[slice(*v)] for k, v in spans.items()} == {
        "a.x": "[1, # one\n 2]",
        "a.y": '"""\n[b]\nz = 1\n"""',
        "c.0.k": '"1"',
        "c.1.k": '"2"',
    }


def test_a_unit_that_a_column_wants_is_asked_for_at_a_field_of_its_own(tmp_path):
    root = small_run.write(tmp_path / "raw" / "small", visits=2)
    schedule = (root / "trials.csv").read_text()
    text = manifest_text.with_value((root / "campaign.toml").read_text(), "trials.units.start", "")
    found = draft.check(root, text, schedule)
    (refusal,) = found.refusals
    assert refusal.key == "trials.units.start"
    (asked,) = (f for f in found.fields if f["key"] == "trials.units.start")
    assert (asked["value"], "s" in asked["choices"]) == ("", True)
    made = manifest_text.with_value(text, "trials.units.start", "s")
    assert draft.check(root, made, schedule).refusals == []


def test_what_is_said_of_a_key_stands_beside_it(tmp_path):
    fields = {f["key"]: f["remark"] for f in draft.check(tmp_path, TEMPLATE, "").fields}
    assert fields["rig.held"].startswith("throttle | voltage")
    assert fields["vehicle.contact.ground"].startswith("from the datum")
    assert fields["vehicle.name"] == ""


def test_a_refusal_stands_at_its_field(tmp_path):
    root = small_run.write(tmp_path / "raw" / "small", visits=2)
    text, schedule = ((root / n).read_text() for n in ("campaign.toml", "trials.csv"))
    assert draft.check(root, text, schedule).refusals == []
    wrong = manifest_text.with_value(text, "vehicle.mass", "27 mm")
    (refusal,) = draft.check(root, wrong, schedule).refusals
    assert refusal.key == "vehicle.mass"
    assert "27 mm" in refusal.text
    (refusal,) = draft.check(root, text, schedule.replace("ground", "grund")).refusals
    assert (refusal.line, refusal.column) == (2, "boundary")
    assert "did you mean 'ground'" in refusal.text
    (refusal,) = draft.check(
        root, text, schedule.replace("\n", ",1\n").replace(",1", "", 1)
    ).refusals
    assert (refusal.line, refusal.column) == (2, "")
    blank = draft.check(root, TEMPLATE, schedule).refusals
    assert {"vehicle.mass", "rig.held"} <= {r.key for r in blank}


def test_the_hover_weight_tells_unit_and_sign(tmp_path):
    root = small_run.write(tmp_path / "raw" / "small", visits=2)
    text = (root / "campaign.toml").read_text()
    schedule = (root / "trials.csv").read_text()

    def reads(key, value):
        return draft.check(root, manifest_text.with_value(text, key, value), schedule).reads

    mass = leaves(text)["vehicle.mass"]
    assert f"hover weight {mass}" in reads("records.force.sign", "1")
    assert "is the unit" in reads("records.force.unit", "N")
    assert "change the sign" in reads("records.force.sign", "-1")


def test_channels_are_thinned_and_keep_their_ends(tmp_path):
    root = small_run.write(tmp_path / "raw" / "small", visits=2)
    record = next((root / "trials").iterdir())
    own = draft.inspected(record).contents.channels
    for c, drawn in zip(own, draft.channels(record), strict=True):
        ys = [y for _, y in drawn["points"]]
        assert (min(ys), max(ys)) == (c.values.min(), c.values.max())
        assert len(ys) <= 2 * draft.DRAWN


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    root = tmp_path_factory.mktemp("draft") / "work"
    small_run.write(root / "raw" / "small", visits=2)
    with served(root) as own:
        own.enter()
        yield own


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("../x", "a.csv"),
        ("..", "a.csv"),
        ("X", "a.csv"),
        ("fresh", "../../a.csv"),
        ("fresh", ".hidden"),
        ("fresh", "a/b.csv"),
        ("fresh", "a\\b.csv"),
        ("fresh", "a\0.csv"),
        ("fresh", ""),
        ("fresh", "n" * 300),
        ("small", "t0000.csv"),
    ],
)
def test_no_upload_lands_elsewhere_or_over_a_campaign(client, name, file):
    before = state(client.root)
    where = f"/upload?name={quote(name)}&file={quote(file, safe='')}"
    assert client.ask("POST", where, b"1,2\n")[0] == 409
    assert state(client.root) == before


def test_an_upload_is_whole_and_never_overwrites(client):
    where = "/upload?name=fresh&file=a.csv"
    assert client.ask("POST", where, b"force\n1\n")[0] == 200
    assert client.ask("POST", where, b"force\n2\n")[0] == 409
    folder = client.root / "raw" / "fresh" / "trials"
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == {"a.csv": b"force\n1\n"}


def test_an_upload_that_is_too_large_leaves_nothing(tmp_path, monkeypatch):
    import asyncio

    monkeypatch.setattr(draft, "MOST_BYTES", 1000)

    async def parts():
        for _ in range(20):
            yield b"x" * 100

    with pytest.raises(NearliftError, match="more than 1000 bytes"):
        asyncio.run(draft.receive(ServedWorkspace(tmp_path), "rig", "a.csv", parts()))
    assert not any(p.is_file() for p in tmp_path.rglob("*"))


def test_a_folder_that_is_a_link_elsewhere_gets_nothing(tmp_path):
    import asyncio

    root, other = tmp_path / "work", tmp_path / "other"
    (root / "raw").mkdir(parents=True)
    other.mkdir()
    (root / "raw" / "rig").symlink_to(other)

    async def parts():
        yield b"x"

    with pytest.raises(NearliftError, match="not in this workspace"):
        asyncio.run(draft.receive(ServedWorkspace(root), "rig", "a.csv", parts()))
    assert not any(other.iterdir())


def fields(root, **changes):
    given = {
        "campaign": "raw/small",
        "manifest": (root / "campaign.toml").read_text(),
        "schedule": (root / "trials.csv").read_text(),
        "known": draft.digest(root / "campaign.toml"),
        "known_schedule": draft.digest(root / "trials.csv"),
    }
    return urlencode(given | changes).encode()


def test_what_somebody_else_changed_is_not_overwritten(client):
    root = client.root / "raw" / "small"
    body = fields(root, manifest="mine", known="0" * 64)
    before = state(client.root)
    _, _, text = client.ask("POST", "/save", body)
    assert "was changed by somebody else" in text
    assert ">mine</textarea>" in text
    assert state(client.root) == before


def test_saving_touches_manifest_and_schedule_alone(client):
    root = client.root / "raw" / "small"
    before = state(root)
    text = (root / "campaign.toml").read_text() + "# a remark\n"
    status, headers, _ = client.ask("POST", "/save", fields(root, manifest=text))
    assert status == 303
    assert "saved" in client.ask("GET", headers["Location"])[2]
    after = state(root)
    changed = {n for n in before.keys() | after.keys() if before.get(n) != after.get(n)}
    assert {name.split("/")[-1] for name in changed} <= {"campaign.toml", "raw/small"}
    assert (root / "campaign.toml").read_text() == text


def test_killed_while_saving_it_leaves_the_old_or_the_new(tmp_path):
    root = small_run.write(tmp_path / "raw" / "small", visits=2)
    old = (root / "campaign.toml").read_text()
    texts = [old] + [old + f"# {i} " + "x" * 200_000 + "\n" for i in range(40)]
    with served(tmp_path) as own:
        own.enter()

        def save():
            for text in texts[1:]:
                try:
                    own.ask("POST", "/save", fields(root, manifest=text))
                except OSError:
                    return

        busy = threading.Thread(target=save)
        busy.start()
        deadline = time.monotonic() + 60
        while (root / "campaign.toml").read_text() == old and time.monotonic() < deadline:
            time.sleep(0.01)
        os.kill(own.process.pid, signal.SIGKILL)
        busy.join()
    assert (root / "campaign.toml").read_text() in texts
    left = {p.name for p in root.iterdir()} - {"campaign.toml", "trials.csv", "trials"}
    assert all(re.fullmatch(r"\..*\.tmp|SHA256SUMS|truth.*", name) for name in left), left
