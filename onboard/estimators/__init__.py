"""Estimators: a model, a filter and a policy; one file each, found by name."""
