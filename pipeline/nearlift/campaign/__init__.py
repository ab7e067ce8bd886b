"""The manifest `campaign.toml`, checked and typed."""
