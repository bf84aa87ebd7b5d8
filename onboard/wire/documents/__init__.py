"""JSON documents -> records: detections, radar scans, pseudoranges, kept state."""
