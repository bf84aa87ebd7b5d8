"""`onboard study`: the claims of a paper, measured. The studies stand beside this package, in the source tree."""

import argparse
from importlib import import_module

from onboard import UserError
from onboard.analysis.parallel.cluster import SOURCE_TREE, STUDIES, find_studies


def main(arguments: argparse.Namespace) -> int:
    """Hand over to `studies.command`, as `python -m studies` does. Raises UserError: there are none here."""
    if not find_studies():
        raise UserError(
            f"study: studies are in the source tree, and this is an installed package ({SOURCE_TREE}): "
            f"in a checkout of the sources, `make install`, then `python -m {STUDIES} NAME` there"
        )
    code: int = import_module(f"{STUDIES}.command").main(arguments)
    return code
