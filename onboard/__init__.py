"""The companion-computer daemon."""
