"""Forecasts of a campaign: detectable effects of a plan, next visits, and the account of an effect.

They share `forecast`. Nothing here opens a file.
"""
