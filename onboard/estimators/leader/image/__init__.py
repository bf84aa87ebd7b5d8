"""What one image measures, and from where it was taken; nothing here knows what is believed of the leader."""
