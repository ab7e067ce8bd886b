"""Measured campaigns through the loop: `make measured`, or ``python -m measured``."""
