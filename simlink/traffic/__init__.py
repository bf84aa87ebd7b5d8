"""Other aircraft: how they fly, what they report, and what a radar sees of them."""
