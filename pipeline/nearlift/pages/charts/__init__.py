"""The interactive charts of index.html: Vega-Lite specifications, the data that they draw, and the
controls that switch them.
"""
