"""The thin shell: each stage reads products, calls the core, writes products. Only stages touch the
disk.
"""
