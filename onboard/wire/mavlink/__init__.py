"""MAVLink bytes and messages <-> records in SI units; frames and signatures."""
