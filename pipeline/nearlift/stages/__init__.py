"""The thin shell, which alone touches the disk: it reads products, calls the core, writes them."""
