"""A fitted lift model as source text: C, Python and JSON. Opens no file."""
