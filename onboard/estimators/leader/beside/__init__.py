"""What is known of the leader beside its images: its broadcast, and ranges. Start reading at `measurements`."""
