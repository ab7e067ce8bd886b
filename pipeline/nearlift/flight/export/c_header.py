"""C99 header of a fitted lift model for firmware: distances in metres, single or double precision,
no heap, no state, no library.
"""

from __future__ import annotations

from collections.abc import Iterable

from nearlift.flight.export.hermite import HermiteTable, UncertaintyTable
from nearlift.flight.export.model_export import ExportedLift, ModelExport

#: Types and functions common to all headers, guarded so that one file may include several. NaN and
#: range are tested on bits read through `volatile`: under -ffast-math compilers assume that no
#: argument is a NaN.
COMMON = """
#ifndef NEARLIFT_TYPES
#define NEARLIFT_TYPES
#include <stdint.h>

#ifdef NEARLIFT_DOUBLE
typedef double nearlift_real;
typedef int64_t nearlift_bits;
#define NEARLIFT_REAL(x) x
#define NEARLIFT_LARGEST INT64_C(0x7fffffffffffffff)
#define NEARLIFT_INFINITY INT64_C(0x7ff0000000000000)
#define NEARLIFT_HALVINGS 60
#else
typedef float nearlift_real;
typedef int32_t nearlift_bits;
#define NEARLIFT_REAL(x) x##f
#define NEARLIFT_LARGEST INT32_C(0x7fffffff)
#define NEARLIFT_INFINITY INT32_C(0x7f800000)
#define NEARLIFT_HALVINGS 30
#endif

/* flag: 0 valid, -1 nearer than measured, +1 farther, 2 not a number */
typedef struct {
    nearlift_real ratio;   /* R = L / L_inf */
    nearlift_real slope;   /* dR/dz, 1/m */
    nearlift_real u_ratio; /* standard uncertainty of R */
    nearlift_real u_slope; /* of dR/dz, 1/m */
    int flag;
} nearlift_lift;

typedef struct {
    nearlift_real z_m; /* distance, m */
    nearlift_real u_m; /* its standard uncertainty, m; at most the range measured */
    int flag;
} nearlift_height;

typedef struct {
    nearlift_real radius_m, low_m, high_m;
    nearlift_real w_low, per_w;             /* w = radius / (radius + z) */
    const nearlift_real (*piece)[2];        /* ratio, and its slope per piece */
    int pieces;
    nearlift_real u_per_w;
    const nearlift_real (*u)[2];            /* standard uncertainty of R and of dR/dz_hat */
    int u_pieces;
    nearlift_real power;                    /* of the fall beyond high_m */
} nearlift_table;

/* An integer that orders as x does; of a NaN it lies beyond that of either infinity. */
static inline nearlift_bits nearlift_order(nearlift_real x)
{
    volatile union {
        nearlift_real value;
        nearlift_bits bits;
    } seen;
    nearlift_bits bits;
    seen.value = x;
    bits = seen.bits;
    return bits < 0 ? -(bits & NEARLIFT_LARGEST) : bits;
}

/* 2 where x is not a number, 1 above high, -1 below low, else 0. */
static inline int nearlift_outside(nearlift_real x, nearlift_real low, nearlift_real high)
{
    const nearlift_bits at = nearlift_order(x);
    if (at > NEARLIFT_INFINITY || at < -NEARLIFT_INFINITY) {
        return 2;
    }
    return at > nearlift_order(high) ? 1 : at < nearlift_order(low) ? -1 : 0;
}

/* Ratio at x pieces from the far end, and its slope per piece. */
static inline nearlift_real nearlift_piece(const nearlift_table *m, nearlift_real x, nearlift_real *slope)
{
    int i = (int)x;
    nearlift_real t, a, d, p, q, c, e;
    i = i < 0 ? 0 : i > m->pieces - 1 ? m->pieces - 1 : i;
    t = x - (nearlift_real)i;
    t = t < 0 ? 0 : t > 1 ? 1 : t;
    a = m->piece[i][0];
    d = m->piece[i + 1][0] - a;
    p = m->piece[i][1];
    q = m->piece[i + 1][1];
    c = 3 * d - 2 * p - q;
    e = p + q - 2 * d;
    *slope = p + t * (2 * c + 3 * t * e);
    return a + t * (p + t * (c + t * e));
}

static inline nearlift_lift nearlift_evaluate(const nearlift_table *m, nearlift_real z_m)
{
    const int flag = nearlift_outside(z_m, m->low_m, m->high_m);
    const nearlift_real z = flag == 0 ? z_m : flag == 1 ? m->high_m : m->low_m;
    const nearlift_real w = m->radius_m / (m->radius_m + z);
    nearlift_real x = (w - m->w_low) * m->u_per_w;
    nearlift_real t, slope;
    nearlift_lift found;
    int i = (int)x;
    i = i < 0 ? 0 : i > m->u_pieces - 1 ? m->u_pieces - 1 : i;
    t = x - (nearlift_real)i;
    found.u_ratio = m->u[i][0] + t * (m->u[i + 1][0] - m->u[i][0]);
    found.u_slope = (m->u[i][1] + t * (m->u[i + 1][1] - m->u[i][1])) / m->radius_m;
    found.ratio = nearlift_piece(m, (w - m->w_low) * m->per_w, &slope);
    found.slope = -slope * m->per_w * w * w / m->radius_m;
    found.flag = flag;
    if (flag == 1) {
        /* farther than measured: R - 1 falls as 1 / (1 + p s + s^2), s = z / high - 1 */
        nearlift_real s = z_m / m->high_m - 1, fall;
        if (nearlift_outside(s, 0, NEARLIFT_REAL(1e6)) == 1) {
            s = NEARLIFT_REAL(1e6);
        }
        fall = 1 / (1 + s * (m->power + s));
        found.slope = (1 - found.ratio) * fall * fall * (m->power + 2 * s) / m->high_m;
        found.ratio = 1 + (found.ratio - 1) * fall;
    } else if (flag != 0) {
        found.slope = 0;
        found.ratio = flag == 2 ? 1 : found.ratio;
    }
    return found;
}

/* Distance at which the ratio is that; u_ratio is the standard uncertainty with which it is known,
   to which the model's own is added. */
static inline nearlift_height nearlift_invert(const nearlift_table *m, nearlift_real ratio, nearlift_real u_ratio)
{
    const nearlift_real far = m->piece[0][0], near = m->piece[m->pieces][0], width = m->high_m - m->low_m;
    const int rises = near > far;
    nearlift_real low = 0, high = (nearlift_real)m->pieces, w, slope, square, u;
    nearlift_lift at;
    nearlift_height found;
    int i;
    found.flag = rises ? nearlift_outside(ratio, far, near) : nearlift_outside(ratio, near, far);
    if (nearlift_outside(u_ratio, 0, NEARLIFT_REAL(1e6)) != 0) {
        found.flag = 2;
    }
    found.u_m = width;
    if (found.flag != 0) {
        found.flag = found.flag == 2 || !rises ? found.flag : -found.flag;
        found.z_m = found.flag == -1 ? m->low_m : m->high_m;
        return found;
    }
    for (i = 0; i < NEARLIFT_HALVINGS; i++) {
        const nearlift_real middle = NEARLIFT_REAL(0.5) * (low + high);
        if ((nearlift_piece(m, middle, &slope) > ratio) == rises) {
            high = middle;
        } else {
            low = middle;
        }
    }
    w = m->w_low + NEARLIFT_REAL(0.5) * (low + high) / m->per_w;
    found.z_m = m->radius_m * (1 - w) / w;
    at = nearlift_evaluate(m, found.z_m < m->low_m ? m->low_m : found.z_m > m->high_m ? m->high_m : found.z_m);
    square = u_ratio * u_ratio + at.u_ratio * at.u_ratio;
    u = u_ratio + at.u_ratio;
    for (i = 0; i < 4 && u > 0; i++) {
        u = NEARLIFT_REAL(0.5) * (u + square / u); /* Newton's root, good to rounding */
    }
    slope = at.slope < 0 ? -at.slope : at.slope;
    if (u < slope * width) {
        found.u_m = u / slope;
    }
    return found;
}
#endif
"""
FUNCTION = """
#define NEARLIFT_{UPPER}_LOW_M {low}
#define NEARLIFT_{UPPER}_HIGH_M {high}
static const nearlift_real nearlift_{name}_piece[{nodes}][2] = {{
{rows}
}};
static const nearlift_real nearlift_{name}_u[{u_nodes}][2] = {{
{u_rows}
}};
static const nearlift_table nearlift_{name}_table = {{
    NEARLIFT_{CAMPAIGN}_RADIUS_M, NEARLIFT_{UPPER}_LOW_M, NEARLIFT_{UPPER}_HIGH_M,
    {w_low}, {per_w}, nearlift_{name}_piece, {pieces},
    {u_per_w}, nearlift_{name}_u, {u_pieces}, {power}
}};

static inline nearlift_lift nearlift_{name}(nearlift_real z_m)
{{
    return nearlift_evaluate(&nearlift_{name}_table, z_m);
}}
"""
INVERSE = """
static inline nearlift_height nearlift_{name}_height(nearlift_real ratio, nearlift_real u_ratio)
{{
    return nearlift_invert(&nearlift_{name}_table, ratio, u_ratio);
}}
"""
USE = """

nearlift_{campaign}_<boundary>(z_m) takes metres and returns ratio, slope dR/dz, their standard uncertainties, and the flag.
It reads tables in r / (r + z) and calls nothing.
nearlift_{campaign}_<boundary>_height(ratio, u_ratio) is its inverse: the distance in metres, its standard uncertainty, and the flag.
nearlift_{campaign}_<boundary>_rotor0(z_m) and on, where the model has them, are those of each rotor, at the tilt of the trials.
Numbers are floats; doubles where NEARLIFT_DOUBLE is defined before the first header. One file may include headers of several campaigns."""


def number(value: float) -> str:
    """A constant of the header's type, with the digits that identify a double exactly."""
    return f"NEARLIFT_REAL({float(value)!r})"


def header(export: ModelExport) -> str:
    """Source text of the header."""
    campaign = "".join(c.lower() if c.isalnum() else "_" for c in export.campaign)
    guard = f"NEARLIFT_{campaign.upper()}_H"
    lines = (*export.about(), *USE.format(campaign=campaign).splitlines())
    about = "".join(f" * {line}".rstrip() + "\n" for line in lines)
    parts = [
        "/*\n" + about.replace("*/", "* /") + " */\n",
        f"#ifndef {guard}\n#define {guard}\n",
        COMMON,
        f"\n#define NEARLIFT_{campaign.upper()}_RADIUS_M {number(export.rotor_radius_m)}\n",
    ]
    functions = (
        _functions(f"{campaign}_{boundary}", campaign, lift, export.rotor_radius_m)
        for boundary, lift in export.boundaries.items()
    )
    return "".join([*parts, *functions, "\n#endif\n"])


def _functions(name: str, campaign: str, lift: ExportedLift, radius_m: float) -> str:
    text = _function(name, campaign, lift.table, lift.uncertainty, radius_m)
    if lift.inverse is None:
        text += INVERSE.format(name=name)
    return text + "".join(
        _function(f"{name}_rotor{i}", campaign, table, lift.uncertainty, radius_m)
        for i, table in enumerate(lift.rotors)
    )


def _function(
    name: str, campaign: str, t: HermiteTable, u: UncertaintyTable, radius_m: float
) -> str:
    return FUNCTION.format(
        name=name,
        UPPER=name.upper(),
        CAMPAIGN=campaign.upper(),
        low=number(t.low * radius_m),
        high=number(t.high * radius_m),
        nodes=len(t.value),
        pieces=t.pieces,
        rows=_rows(zip(t.value.tolist(), t.slope.tolist(), strict=True)),
        w_low=number(t.w_low),
        per_w=number(t.per_w),
        power=number(t.power),
        u_nodes=len(u.ratio),
        u_pieces=len(u.ratio) - 1,
        u_rows=_rows(zip(u.ratio.tolist(), u.slope.tolist(), strict=True)),
        u_per_w=number(u.per_w),
    )


def _rows(pairs: Iterable[tuple[float, float]]) -> str:
    return ",\n".join(f"    {{{number(a)}, {number(b)}}}" for a, b in pairs)
