"""Diagnosis of a base fit's residuals: the test for structure, the physical effect that explains
it, and the effects that the design cannot tell from it.
"""
