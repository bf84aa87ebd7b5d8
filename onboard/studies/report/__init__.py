"""The kit every study reports with: claims, checks, misprints, tables, figures, and processes to compute in."""
