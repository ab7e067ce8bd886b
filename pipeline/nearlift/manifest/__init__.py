"""What a campaign declares: `campaign.toml`, checked and typed."""
