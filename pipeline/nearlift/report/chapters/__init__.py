"""The chapters of index.html: what the products say, in words and numbers, each number with its
source.
"""
