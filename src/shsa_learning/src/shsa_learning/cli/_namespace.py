"""The option for the namespace of a robot."""
import argparse


def add_namespace(parser: argparse.ArgumentParser) -> None:
    """Add --namespace."""
    parser.add_argument(
        "--namespace",
        metavar="NAME",
        default="/",
        help="where relative names of topics and nodes are (/)",
    )
