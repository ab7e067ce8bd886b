"""From files to a manifest: what an instrument's file holds, and the campaign that reads it."""
