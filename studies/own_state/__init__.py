"""The study of our own state under faults: its accuracy, and the delay of their detection.

`study` runs it.
"""
