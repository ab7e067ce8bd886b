"""Exported lift models as C and Python source, from the templates of this folder."""

from __future__ import annotations

import jinja2

from nearlift.flight.export.model_export import ModelExport


def c_header(export: ModelExport) -> str:
    """C99 header for firmware: metres in, single or double precision, no heap, state or library."""
    name = "".join(c.lower() if c.isalnum() else "_" for c in export.campaign)
    about = _rendered("about.txt", export).replace("*/", "* /")
    return _rendered("lift_model.h", export, about=about.splitlines(), name=name)


def python_module(export: ModelExport) -> str:
    """Python module without dependencies."""
    # the header comment becomes a docstring, which quotes or backslashes could end
    about = _rendered("about.txt", export).replace("\\", "/").replace('"', "'")
    return _rendered("lift_model.py", export, about=about)


def _rendered(template: str, export: ModelExport, **values: object) -> str:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("nearlift.flight.export", "."),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    environment.filters["real"] = lambda number: f"NEARLIFT_REAL({float(number)!r})"
    return environment.get_template(f"{template}.jinja").render(export=export, zip=zip, **values)
