"""Accuracy of estimates against a truth (leader, own state, traffic), and the scorecard."""
