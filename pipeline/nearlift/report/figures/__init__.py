"""One module or package per figure: the table of exactly what is drawn, its caption and alternative
text, and the drawing, which computes no number.
"""

from nearlift import isolation

isolation.library("matplotlib")
