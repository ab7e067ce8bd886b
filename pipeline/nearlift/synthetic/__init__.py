"""Campaigns with known truth, written at record level from the declarations: for the demo, for
planning, for tests.
"""
