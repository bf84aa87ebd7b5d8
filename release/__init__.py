"""The files of a release, made by `make wheel` and `make release`; nothing here is installed."""
