"""The heart of the program: `Pipeline` in `pipeline.py`, and what it asks of its own parts."""

from onboard.pipeline.pipeline import Pipeline
from onboard.pipeline.report import Rim

__all__ = ["Pipeline", "Rim"]
