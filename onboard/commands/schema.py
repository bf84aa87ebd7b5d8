"""`onboard schema`: what is published."""

import argparse

import msgspec

from onboard.messages import schemas


def main(arguments: argparse.Namespace) -> int:
    """Print the published records as tables, or as JSON Schema."""
    if arguments.json:
        print(msgspec.json.format(msgspec.json.encode(schemas.schemas())).decode())
    else:
        print(schemas.describe())
    return 0
