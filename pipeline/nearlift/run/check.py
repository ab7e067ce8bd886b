"""Comparison of a campaign's inputs and products with the digests in provenance.json."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from nearlift.campaign.manifest import Campaign
from nearlift.errors import ProductError
from nearlift.products import PROVENANCE
from nearlift.run import store
from nearlift.run.inputs import listing
from nearlift.run.job import PIV_INPUT
from nearlift.run.lock import settled
from nearlift.run.transaction import Homes


def differences(root: Path, out: Path, campaign: Campaign) -> tuple[int, list[str]]:
    """Number of entries in provenance.json, and a line for each whose digest differs.

    An entry is a file, or all velocity grids of one case.

    Raises
    ------
    ProductError
        There is no provenance.json, or it is damaged.
    """
    homes = Homes.within(out, campaign.name)
    settled(homes)
    path = homes.processed / PROVENANCE.file
    inputs, outputs = _entries(store.read_json(path), str(path))
    grids = {}
    for case in campaign.piv.case if campaign.piv is not None else ():
        label, files = listing(root, case)
        grids[label] = store.listing_sha256({name: store.sha256(root / name) for name in files})
    differing = []
    for name, sha in inputs.items():
        if name.startswith(PIV_INPUT):
            what = "are not what they were" if name in grids else "are other files by now"
            differing += [f"{name}: {what}"] if grids.get(name) != sha else []
        else:
            differing += _difference(root / name, sha)
    for name, sha in outputs.items():
        differing += _difference(homes.place(name), sha)
    return len(inputs) + len(outputs), differing


def _entries(content: dict[str, Any], where: str) -> tuple[dict[str, str], dict[str, str]]:
    """Digests of inputs and of products, by name."""
    try:
        inputs = {str(name): str(entry["sha256"]) for name, entry in content["inputs"].items()}
        outputs = {
            str(name): str(sha)
            for stage in content["stages"].values()
            for name, sha in stage["outputs"].items()
        }
    except (KeyError, TypeError, AttributeError):
        raise ProductError(
            where,
            "is not what nearlift writes",
            "restore it from a copy, or delete it and run again",
        ) from None
    return inputs, outputs


def _difference(path: Path, sha: str) -> list[str]:
    if not path.is_file():
        return [f"{path}: is missing"]
    return [] if store.sha256(path) == sha else [f"{path}: is not what it was"]
