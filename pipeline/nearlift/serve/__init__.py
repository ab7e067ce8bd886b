"""The bench's page: a browser's view of one workspace, served to this machine alone. What a button
does, a command does.
"""
