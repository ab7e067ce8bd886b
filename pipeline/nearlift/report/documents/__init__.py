"""Texts for a paper: methods and references, tables in LaTeX and CSV."""
