"""The option --namespace: apart from others, which load what draws tables."""
import argparse

from shsa_core.cli._common import ros_namespace


def add_namespace(parser: argparse.ArgumentParser) -> None:
    """Add --namespace."""
    parser.add_argument(
        "--namespace",
        metavar="NAME",
        type=ros_namespace,
        default="/",
        help="where relative names of topics and nodes are (/)",
    )
