"""Figure 2: Delta L against distance at each boundary, on paper and as an interactive chart."""
