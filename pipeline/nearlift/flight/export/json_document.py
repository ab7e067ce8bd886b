"""JSON document of a fitted lift model, and its JSON Schema."""

from __future__ import annotations

from dataclasses import asdict

from nearlift.flight.export.hermite import HermiteTable
from nearlift.flight.export.model_export import ModelExport

SCHEMA_NAME = "nearlift.lift_model/2"
_NUMBER, _TEXT = {"type": "number"}, {"type": "string"}
_NUMBERS = {"type": "array", "items": _NUMBER, "minItems": 2}


def _object(properties: dict[str, object], description: str = "") -> dict[str, object]:
    """Schema of an object that has all of these properties."""
    about = {"description": description} if description else {}
    return {"type": "object", **about, "required": [*properties], "properties": properties}


_INTERVAL = _object({"value": _NUMBER, "lo90": _NUMBER, "hi90": _NUMBER, "unit": _TEXT})
_TABLE = _object(
    {
        "w_low": _NUMBER,
        "per_w": _NUMBER,
        "value": _NUMBERS,
        "slope": _NUMBERS,
        "relative_error": _NUMBER,
    },
    "cubic Hermite pieces in w = 1 / (1 + z_hat) from w_low on, per_w to a unit; slope per piece",
)
_BOUNDARY = _object(
    {
        "model": _TEXT,
        "formula": {"type": "string", "description": "LaTeX of the base model"},
        "effects": {"type": "array", "items": _TEXT},
        "omitted": {
            "type": "array",
            "description": (
                "effects that were found and are not in the ratio: they act in time, or"
                " belong to the bench"
            ),
            "items": _TEXT,
        },
        "parameters": {"type": "object", "additionalProperties": _INTERVAL},
        "covariance": {
            "type": "object",
            "description": "a row to each parameter, in the same order",
            "additionalProperties": {"type": "array", "items": _NUMBER},
        },
        "known": {"type": "object", "additionalProperties": _NUMBER},
        "valid_z_hat": {**_NUMBERS, "maxItems": 2},
        "ratio": {
            "type": "array",
            "description": "L / L_inf with its 90 % interval at some heights",
            "items": {**_INTERVAL, "required": ["z_hat", "value", "lo90", "hi90"]},
        },
        "table": _TABLE,
        "uncertainty": _object(
            {"per_w": _NUMBER, "ratio": _NUMBERS, "slope": _NUMBERS},
            "standard uncertainty, by the parameters, of the ratio and of its slope in z_hat, at"
            " nodes of w from the table's w_low on, per_w to a unit; linear between them",
        ),
        "rotors": {
            "type": "array",
            "description": "the table of each rotor, where the model has them",
            "items": _TABLE,
        },
        "beyond": _object(
            {"power": _NUMBER},
            "farther than valid_z_hat the ratio less 1 falls as 1 / (1 + power s + s^2),"
            " s = z_hat / valid_z_hat[1] - 1",
        ),
    }
)
SCHEMA: dict[str, object] = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "title": SCHEMA_NAME,
    **_object(
        {
            "schema": {"const": SCHEMA_NAME},
            "campaign": _TEXT,
            "nearlift": _TEXT,
            "trials_sha256": {"type": "string", "pattern": "^[0-9a-f]{64}$"},
            "date": _TEXT,
            "rotor_radius_m": {"type": "number", "exclusiveMinimum": 0},
            "held": {"enum": ["throttle", "voltage", "rpm", "power"]},
            "boundaries": {"type": "object", "additionalProperties": _BOUNDARY},
        }
    ),
}


def _table(table: HermiteTable) -> dict[str, object]:
    return {
        "w_low": table.w_low,
        "per_w": table.per_w,
        "value": table.value,
        "slope": table.slope,
        "relative_error": table.error,
    }


def document(export: ModelExport) -> dict[str, object]:
    """Content of the JSON document, typed."""
    return {
        "schema": SCHEMA_NAME,
        "campaign": export.campaign,
        "nearlift": export.nearlift,
        "trials_sha256": export.digest,
        "date": export.date,
        "rotor_radius_m": export.radius_m,
        "held": export.held,
        "boundaries": {
            lift.boundary: {
                "model": lift.model,
                "formula": lift.formula,
                "effects": list(lift.effects),
                "omitted": list(lift.omitted),
                "parameters": lift.parameters,
                "covariance": lift.covariance,
                "known": lift.known,
                "valid_z_hat": [lift.table.low, lift.table.high],
                "ratio": [{"z_hat": z, **asdict(r)} for z, r in lift.at.items()],
                "table": _table(lift.table),
                "uncertainty": lift.uncertainty,
                "rotors": [_table(rotor) for rotor in lift.rotors],
                "beyond": {"power": lift.table.power},
            }
            for lift in export.lifts
        },
    }
