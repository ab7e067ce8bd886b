"""The report of a campaign: figures with their tables and captions, the chapters of index.html,
and the documents for a paper.
"""
