"""A fitted lift model as source text: C, Python, CasADi and JSON. Opens no file."""
