"""Study of a leader's manoeuvres, drop-outs and a killed daemon, for followers of both autopilots."""
