"""What a boundary changes: airspeed less the control's, in vehicle axes."""

from __future__ import annotations

import numpy as np

from nearlift.declare import FloatArray
from nearlift.flow.field import VelocityField, take_columns


def at(values: FloatArray, source: VelocityField, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
    """A map (ny, nx) of `source` at other nodes, linear between its own; nan outside and beside
    missing vectors.
    """
    across = _inside(values, (x_m - source.x_m[0]) / source.dx_m)
    return _inside(across.T, (y_m - source.y_m[0]) / source.dy_m).T


def _inside(values: FloatArray, position: FloatArray) -> FloatArray:
    n = values.shape[-1]
    taken = take_columns(values, position)
    return np.where((position > -1e-6) & (position < n - 1 + 1e-6), taken, np.nan)


def difference(case: VelocityField, control: VelocityField) -> FloatArray:
    """Airspeed of the case less that of the control on the case's nodes, (ny, nx)."""
    result: FloatArray = case.speed_m_s - at(control.speed_m_s, control, case.x_m, case.y_m)
    return result
