"""A C99 header for firmware: floats only, no heap, no state; the table form calls no library, the
closed form wants math.h.
"""

from __future__ import annotations

from nearlift.flight.export.closed_form import write
from nearlift.flight.export.model_export import ExportedLift, ModelExport

#: What every header holds, once in a file: type, clamp and cubic piece. NaN is told by its bits, which
#: -ffast-math leaves alone.
COMMON = """
#ifndef NEARLIFT_RATIO
#define NEARLIFT_RATIO
#include <stdint.h>

typedef struct {
    float ratio; /* L / L_inf */
    int flag;    /* 0 valid, -1 nearer than measured, +1 farther, 2 not a number */
} nearlift_ratio;

static inline float nearlift_clamp(float z_hat, float low, float high, int *flag)
{
    union {
        float value;
        uint32_t bits;
    } z;
    z.value = z_hat;
    if ((z.bits & 0x7fffffffu) > 0x7f800000u) {
        *flag = 2;
        return high;
    }
    *flag = z_hat > high ? 1 : z_hat < low ? -1 : 0;
    return *flag == 1 ? high : *flag == -1 ? low : z_hat;
}

/* Farther than measured, what the boundary adds falls as the square of distance. */
static inline float nearlift_beyond(float ratio, float z_hat, float high, int flag)
{
    const float fall = flag == 1 ? high / z_hat : 1.0f;
    return flag == 2 ? 1.0f : 1.0f + (ratio - 1.0f) * fall * fall;
}

static inline float nearlift_piece(const float table[][2], int pieces, float w_low, float per_w, float z_hat)
{
    float x = (1.0f / (1.0f + z_hat) - w_low) * per_w;
    int i = (int)x;
    float t, a, d, p, q;
    if (x < 0.0f) {
        x = 0.0f;
        i = 0;
    }
    if (i > pieces - 1) {
        i = pieces - 1;
    }
    t = x - (float)i;
    if (t > 1.0f) {
        t = 1.0f;
    }
    a = table[i][0];
    d = table[i + 1][0] - a;
    p = table[i][1];
    q = table[i + 1][1];
    return a + t * (p + t * ((3.0f * d - 2.0f * p - q) + t * (p + q - 2.0f * d)));
}
#elif !defined(NEARLIFT_LONG_NAMES)
#error "two lift models: define NEARLIFT_LONG_NAMES and call nearlift_<campaign>_<boundary>"
#endif
"""
TABLE = """
#define NEARLIFT_{UPPER}_LOW {low}
#define NEARLIFT_{UPPER}_HIGH {high}

static inline nearlift_ratio nearlift_{name}(float z_hat)
{{
    static const float table[{nodes}][2] = {{
{rows}
    }};
    nearlift_ratio found;
    const float z = nearlift_clamp(z_hat, NEARLIFT_{UPPER}_LOW, NEARLIFT_{UPPER}_HIGH, &found.flag);
    found.ratio = nearlift_piece(table, {pieces}, {w_low}, {per_w}, z);
    found.ratio = nearlift_beyond(found.ratio, z_hat, NEARLIFT_{UPPER}_HIGH, found.flag);
    return found;
}}
"""
CLOSED = """
#ifdef NEARLIFT_CLOSED_FORM
static inline nearlift_ratio nearlift_{name}_closed(float z_hat)
{{
    nearlift_ratio found;
    const float z = nearlift_clamp(z_hat, NEARLIFT_{UPPER}_LOW, NEARLIFT_{UPPER}_HIGH, &found.flag);
    found.ratio = {expression};
    found.ratio = nearlift_beyond(found.ratio, z_hat, NEARLIFT_{UPPER}_HIGH, found.flag);
    return found;
}}
#endif
"""
SHORT = """
#ifndef NEARLIFT_LONG_NAMES
#define nearlift_{boundary} nearlift_{name}
#define nearlift_{boundary}_closed nearlift_{name}_closed
#define NEARLIFT_{BOUNDARY}_LOW NEARLIFT_{UPPER}_LOW
#define NEARLIFT_{BOUNDARY}_HIGH NEARLIFT_{UPPER}_HIGH
#endif
"""
USE = (
    "",
    (
        "nearlift_<boundary>(z_hat) reads a table (cubic pieces in 1 / (1 + z_hat)) and calls"
        " nothing. With NEARLIFT_CLOSED_FORM defined"
    ),
    "nearlift_<boundary>_closed(z_hat) evaluates the formula with math.h.",
    (
        "Every function is also nearlift_<campaign>_<boundary>; for headers of two campaigns in one"
        " file define NEARLIFT_LONG_NAMES, which leaves only those."
    ),
)


def number(value: float) -> str:
    """A float constant: nine digits name every float exactly."""
    text = f"{value:.9g}"
    return (text if "." in text or "e" in text or "n" in text else text + ".0") + "f"


def header(export: ModelExport) -> str:
    """The whole header."""
    campaign = "".join(c.lower() if c.isalnum() else "_" for c in export.campaign)
    guard = f"NEARLIFT_{campaign.upper()}_H"
    about = "".join(f" * {line}".rstrip() + "\n" for line in (*export.about(), *USE))
    parts = [
        "/*\n" + about.replace("*/", "* /") + " */\n",
        f"#ifndef {guard}\n#define {guard}\n",
        COMMON,
    ]
    if any(lift.closed is not None for lift in export.lifts):
        parts.append("\n#ifdef NEARLIFT_CLOSED_FORM\n#include <math.h>\n#endif\n")
    return "".join([*parts, *(_functions(lift, campaign) for lift in export.lifts), "\n#endif\n"])


def _functions(lift: ExportedLift, campaign: str) -> str:
    t = lift.table
    rows = ",\n".join(
        f"        {{{number(v)}, {number(s)}}}"
        for v, s in zip(t.value.tolist(), t.slope.tolist(), strict=True)
    )
    name = f"{campaign}_{lift.boundary}"
    names = {"name": name, "UPPER": name.upper()}
    text = TABLE.format(
        **names,
        low=number(t.low),
        high=number(t.high),
        nodes=len(t.value),
        pieces=t.pieces,
        rows=rows,
        w_low=number(t.w_low),
        per_w=number(t.per_w),
    )
    if lift.closed is not None:
        expression = write(lift.closed, number="{}f", call="{}f")
        text += CLOSED.format(**names, expression=expression)
    return text + SHORT.format(**names, boundary=lift.boundary, BOUNDARY=lift.boundary.upper())
