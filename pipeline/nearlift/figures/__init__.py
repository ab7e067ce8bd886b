"""One module per figure: a tidy table to a matplotlib figure. No number is computed here; what is
drawn is in the table.
"""

from nearlift import isolation

isolation.library("matplotlib")
