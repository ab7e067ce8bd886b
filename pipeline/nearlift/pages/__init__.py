"""index.html and the tables for papers: what the products say, in words and numbers, each number
with where it came from.
"""
