"""What a release consists of: `make wheel` and `make release`. Nothing here is installed."""
