"""`vlod info`: what a store holds, for people and as JSON."""

from __future__ import annotations

import click

from storage.cli.facts import collect
from storage.cli.text import say, sections
from storage.store import open_store


@click.command(epilog="Example: vlod info ship.store", no_args_is_help=True)
@click.argument("store")
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
def info(store: str, as_json: bool) -> None:
    """Say what STORE (a folder or a URL) holds: its model, drawables, cells, and where its bytes are."""
    facts = collect(open_store(store))
    say(facts, sections(facts), as_json=as_json)
