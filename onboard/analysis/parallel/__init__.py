"""Work in parts on all cores of this computer or of a cluster."""
