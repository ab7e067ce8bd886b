"""The model as JSON, and the schema of that JSON."""

from __future__ import annotations

from dataclasses import asdict

from nearlift.flight.export.closed_form import write
from nearlift.flight.export.model_export import ModelExport

SCHEMA_NAME = "nearlift.lift_model/1"
_INTERVAL = {
    "type": "object",
    "required": ["value", "lo90", "hi90", "unit"],
    "properties": {
        "value": {"type": "number"},
        "lo90": {"type": "number"},
        "hi90": {"type": "number"},
        "unit": {"type": "string"},
    },
}
_NUMBERS = {"type": "array", "items": {"type": "number"}, "minItems": 2}
SCHEMA: dict[str, object] = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "title": SCHEMA_NAME,
    "type": "object",
    "required": [
        "schema",
        "campaign",
        "nearlift",
        "trials_sha256",
        "date",
        "rotor_radius_m",
        "held",
        "boundaries",
    ],
    "properties": {
        "schema": {"const": SCHEMA_NAME},
        "campaign": {"type": "string"},
        "nearlift": {"type": "string"},
        "trials_sha256": {"type": "string", "pattern": "^[0-9a-f]{64}$"},
        "date": {"type": "string"},
        "rotor_radius_m": {"type": "number", "exclusiveMinimum": 0},
        "held": {"enum": ["throttle", "voltage", "rpm", "power", "command"]},
        "boundaries": {
            "type": "object",
            "additionalProperties": {
                "type": "object",
                "required": [
                    "model",
                    "formula",
                    "effects",
                    "parameters",
                    "known",
                    "valid_z_hat",
                    "ratio",
                    "table",
                    "closed_form",
                ],
                "properties": {
                    "model": {"type": "string"},
                    "formula": {"type": "string", "description": "LaTeX of the base model"},
                    "effects": {"type": "array", "items": {"type": "string"}},
                    "parameters": {"type": "object", "additionalProperties": _INTERVAL},
                    "known": {"type": "object", "additionalProperties": {"type": "number"}},
                    "valid_z_hat": {**_NUMBERS, "maxItems": 2},
                    "ratio": {
                        "type": "array",
                        "description": "L / L_inf with its 90 % interval at some heights",
                        "items": {**_INTERVAL, "required": ["z_hat", "value", "lo90", "hi90"]},
                    },
                    "table": {
                        "type": "object",
                        "description": (
                            "cubic Hermite pieces in w = 1 / (1 + z_hat) from w_low on, per_w to a"
                            " unit; slope per piece"
                        ),
                        "required": ["w_low", "per_w", "value", "slope", "relative_error"],
                        "properties": {
                            "w_low": {"type": "number"},
                            "per_w": {"type": "number"},
                            "value": _NUMBERS,
                            "slope": _NUMBERS,
                            "relative_error": {"type": "number"},
                        },
                    },
                    "closed_form": {
                        "type": ["string", "null"],
                        "description": "in z, with + - * / and sqrt, exp, log, pow",
                    },
                },
            },
        },
    },
}


def document(export: ModelExport) -> dict[str, object]:
    """The JSON's content."""
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
                "parameters": {n: asdict(p) for n, p in lift.parameters.items()},
                "known": dict(lift.known),
                "valid_z_hat": [lift.table.low, lift.table.high],
                "ratio": [{"z_hat": z, **asdict(r)} for z, r in lift.at.items()],
                "table": {
                    "w_low": lift.table.w_low,
                    "per_w": lift.table.per_w,
                    "value": lift.table.value.tolist(),
                    "slope": lift.table.slope.tolist(),
                    "relative_error": lift.table.error,
                },
                "closed_form": (
                    None if lift.closed is None else write(lift.closed, number="{}", call="{}")
                ),
            }
            for lift in export.lifts
        },
    }
