"""One module per figure: products to the tidy table of exactly what is drawn, its caption and its
alternative text. Nothing is drawn here.
"""
