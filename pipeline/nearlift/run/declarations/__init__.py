"""The stages, a file each: the schema of what one writes, and the declaration of what it is."""
