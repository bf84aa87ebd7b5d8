"""The filters of one target: `filter` is what a track needs of one, `choice` makes the one that is configured."""
