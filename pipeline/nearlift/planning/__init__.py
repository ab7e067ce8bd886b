"""Forecasts of a campaign: what a plan can show, which visits to make next, and what is known of
one effect. All of them ask `loop.foresight`; nothing here opens a file.
"""
