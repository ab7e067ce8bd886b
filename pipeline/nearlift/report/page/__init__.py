"""index.html: one file with its pictures, interactive charts and their library, self-contained."""
