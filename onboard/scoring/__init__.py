"""How good estimates are against a truth: of the leader, of our own state, of traffic; and the scorecard."""
