"""What our own vehicle's sensors measure of the truth, with noise, delays and losses."""
