"""A fitted lift model in forms that other programs run: C, Python, JSON, CasADi. Text in, text out:
opens no file.
"""
