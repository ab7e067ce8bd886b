"""Closing the loop: find the residual, trace it to an effect that the model lacks, add it, and say
what else would have served.
"""
