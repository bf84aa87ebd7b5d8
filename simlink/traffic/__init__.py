"""Other aircraft: their motion, their reports, and our radar's detections of them."""
