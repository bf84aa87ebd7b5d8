"""Links: where bytes come in and go out."""
