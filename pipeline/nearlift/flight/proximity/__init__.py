"""Where is the boundary? What a lift ratio, or the throttle needed to hover, says of it. Opens no
file, draws nothing.
"""
