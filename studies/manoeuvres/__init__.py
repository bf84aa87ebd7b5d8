"""Study: what a leader's manoeuvres, drop-outs and a daemon that is killed do to followers of both autopilots."""
