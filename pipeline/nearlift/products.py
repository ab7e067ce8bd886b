"""Every product under one roof; its schema is declared beside the stage that writes it."""

from __future__ import annotations

from nearlift.run.declarations.detect import DETECTION, PROXIMITY, PROXIMITY_PRODUCTS
from nearlift.run.declarations.diagnose import DIAGNOSIS, LOOP_RESIDUALS, NOT_DIAGNOSED
from nearlift.run.declarations.fit import FIT, POSTERIOR, PROFILES, RESULTS
from nearlift.run.declarations.flow import (
    DOWNWASH,
    DOWNWASH_PROFILE,
    FLOW,
    FLOW_FIELDS,
    FLOW_PRODUCTS,
    FLOW_TOPOLOGY,
)
from nearlift.run.declarations.ingest import TRIALS
from nearlift.run.declarations.reduce import LIFT, LIFT_COVARIANCE
from nearlift.run.declarations.simulate import (
    CRASH_RATES,
    FLIGHTS,
    SAFETY,
    SIMULATION_PRODUCTS,
)
from nearlift.run.registry import PRODUCTS, PROVENANCE
from nearlift.run.schema import Column, Product

__all__ = [
    "CRASH_RATES",
    "DETECTION",
    "DIAGNOSIS",
    "DOWNWASH",
    "DOWNWASH_PROFILE",
    "FIT",
    "FLIGHTS",
    "FLOW",
    "FLOW_FIELDS",
    "FLOW_PRODUCTS",
    "FLOW_TOPOLOGY",
    "LIFT",
    "LIFT_COVARIANCE",
    "LOOP_RESIDUALS",
    "NOT_DIAGNOSED",
    "POSTERIOR",
    "PRODUCTS",
    "PROFILES",
    "PROVENANCE",
    "PROXIMITY",
    "PROXIMITY_PRODUCTS",
    "RESULTS",
    "SAFETY",
    "SIMULATION_PRODUCTS",
    "TRIALS",
    "Column",
    "Product",
]
