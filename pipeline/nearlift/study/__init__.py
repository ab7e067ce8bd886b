"""The Python interface: a campaign opened for work, and what its stages found, as typed values.
`nearlift.load` is the way in.
"""
