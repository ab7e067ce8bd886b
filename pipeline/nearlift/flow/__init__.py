"""Velocity grids to downwash: fields, averages, cuts, contrasts to the control, topology. Pure: no
file, no table, no figure.
"""
