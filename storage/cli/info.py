"""`vlod info`: what a store holds, for people and as JSON."""

from __future__ import annotations

import json
import sys

import click

from storage.cli.facts import collect
from storage.cli.text import plain, sections, show
from storage.store import open_store


@click.command(epilog="Example: vlod info ship.store", no_args_is_help=True)
@click.argument("store")
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
def info(store: str, as_json: bool) -> None:
    """Say what STORE (a folder or a URL) holds: its model, drawables, cells, and where its bytes are."""
    facts = collect(open_store(store))
    if as_json:
        click.echo(json.dumps(facts, indent=1))
    elif sys.stdout.isatty():
        show(sections(facts))
    else:
        click.echo("\n\n".join(plain(section) for section in sections(facts)))
