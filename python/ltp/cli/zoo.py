"""Owns `ltp zoo`: the list of reference models, or the document of one."""

from __future__ import annotations

import argparse

from ltp import zoo
from ltp.cli import common, text


def add(commands: common.Commands) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        "zoo",
        help="list the reference models, or print one",
        description="List the reference models that ship with ltp, or print the document of one: a starting point for\n"
        "your own, with its closed form or reference in the header.",
        epilog=common.epilog("ltp zoo", "ltp zoo drive"),
        formatter_class=common.Formatter,
    )
    parser.add_argument("name", metavar="NAME", nargs="?", help="print the document of this model")
    common.add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the subcommand."""
    if arguments.name is not None:
        document = zoo.text(arguments.name)
        tree = {"name": arguments.name, "document": document}
        print(common.as_json(tree) if arguments.json else document.rstrip("\n"))
        return 0
    models = [(name, zoo.load(name)) for name in zoo.names()]
    if arguments.json:
        print(common.as_json({"models": [{"name": name, "description": model.description} for name, model in models]}))
        return 0
    print(text.table(["name", "what it is"], [[name, model.description] for name, model in models], left=2))
    print("\nprint one with `ltp zoo NAME`; use it anywhere a MODEL is asked for as zoo:NAME")
    return 0
