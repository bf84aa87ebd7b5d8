"""MAVLink bytes and messages <-> records in SI units; frames, signatures, and the files of MAVLink FTP."""
