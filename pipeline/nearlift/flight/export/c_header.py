"""A C99 header for firmware: floats only, no heap, no state; the table form calls no library, the
closed form wants math.h.
"""

from __future__ import annotations

from nearlift.flight.export.closed_form import write
from nearlift.flight.export.model_export import ExportedLift, ModelExport

HEAD = """#ifndef {guard}
#define {guard}

typedef struct {{
    float ratio; /* L / L_inf */
    int flag;    /* 0 valid, -1 nearer than measured or not a number, +1 farther */
}} nearlift_ratio;

static inline float nearlift_clamp(float z_hat, float low, float high, int *flag)
{{
    if (!(z_hat >= low)) {{
        *flag = -1;
        return low;
    }}
    *flag = z_hat > high;
    return z_hat > high ? high : z_hat;
}}

static inline float nearlift_piece(const float table[][2], int pieces, float w_low, float per_w, float z_hat)
{{
    float x = (1.0f / (1.0f + z_hat) - w_low) * per_w;
    int i = (int)x;
    float t, a, d, p, q;
    if (x < 0.0f) {{
        x = 0.0f;
        i = 0;
    }}
    if (i > pieces - 1) {{
        i = pieces - 1;
    }}
    t = x - (float)i;
    if (t > 1.0f) {{
        t = 1.0f;
    }}
    a = table[i][0];
    d = table[i + 1][0] - a;
    p = table[i][1];
    q = table[i + 1][1];
    return a + t * (p + t * ((3.0f * d - 2.0f * p - q) + t * (p + q - 2.0f * d)));
}}
"""
TABLE = """
#define NEARLIFT_{upper}_LOW {low}
#define NEARLIFT_{upper}_HIGH {high}

static inline nearlift_ratio nearlift_{name}(float z_hat)
{{
    static const float table[{nodes}][2] = {{
{rows}
    }};
    nearlift_ratio found;
    const float z = nearlift_clamp(z_hat, NEARLIFT_{upper}_LOW, NEARLIFT_{upper}_HIGH, &found.flag);
    found.ratio = nearlift_piece(table, {pieces}, {w_low}, {per_w}, z);
    return found;
}}
"""
CLOSED = """
#ifdef NEARLIFT_CLOSED_FORM
static inline nearlift_ratio nearlift_{name}_closed(float z_hat)
{{
    nearlift_ratio found;
    const float z = nearlift_clamp(z_hat, NEARLIFT_{upper}_LOW, NEARLIFT_{upper}_HIGH, &found.flag);
    found.ratio = {expression};
    return found;
}}
#endif
"""


def number(value: float) -> str:
    """A float constant: nine digits name every float exactly."""
    text = f"{value:.9g}"
    return (text if "." in text or "e" in text or "n" in text else text + ".0") + "f"


def header(export: ModelExport) -> str:
    """The whole header."""
    guard = "NEARLIFT_" + "".join(c.upper() if c.isalnum() else "_" for c in export.campaign) + "_H"
    comment = (
        "/*\n"
        + "".join(f" * {line}".rstrip() + "\n" for line in (*export.about(), *USE)).replace(
            "*/", "* /"
        )
        + " */\n"
    )
    parts = [comment, HEAD.format(guard=guard)]
    if any(lift.closed is not None for lift in export.lifts):
        parts.append("\n#ifdef NEARLIFT_CLOSED_FORM\n#include <math.h>\n#endif\n")
    return "".join([*parts, *(_functions(lift) for lift in export.lifts), "\n#endif\n"])


USE = (
    "",
    (
        "nearlift_<boundary>(z_hat) reads a table (cubic pieces in 1 / (1 + z_hat)) and calls"
        " nothing. With NEARLIFT_CLOSED_FORM defined"
    ),
    "nearlift_<boundary>_closed(z_hat) evaluates the formula with math.h.",
)


def _functions(lift: ExportedLift) -> str:
    t = lift.table
    rows = ",\n".join(
        f"        {{{number(v)}, {number(s)}}}"
        for v, s in zip(t.value.tolist(), t.slope.tolist(), strict=True)
    )
    names = {"name": lift.boundary, "upper": lift.boundary.upper()}
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
    if lift.closed is None:
        return text
    return text + CLOSED.format(**names, expression=write(lift.closed, number="{}f", call="{}f"))
