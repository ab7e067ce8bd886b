"""Diagnosis of a base fit's residuals: a test for structure, the effect that explains it, and its
rivals.
"""
