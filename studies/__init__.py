"""A folder a paper or study: what it claims, what we measure.

`python -m studies NAME`; not in the wheel.
"""
