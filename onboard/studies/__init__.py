"""Studies: one file per paper; what it claims, what we measure."""
