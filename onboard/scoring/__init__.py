"""Accuracy of estimates against a truth (leader, own state), and the scorecard."""
