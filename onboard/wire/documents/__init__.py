"""JSON documents -> records: detections, radar scans, pseudoranges, and the daemon's kept state."""
