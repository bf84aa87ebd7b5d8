"""The filters of one target: `filter` is what a track needs of one, `make` makes it of a configuration."""
