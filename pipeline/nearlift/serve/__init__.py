"""Read-only page of a workspace in a browser of this machine: campaigns, live, reports."""
