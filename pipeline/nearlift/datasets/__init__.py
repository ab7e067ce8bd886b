"""Public measured data: a list of what there is, fetched by URL and digest, made into campaigns.
The data themselves are not in the package.
"""
