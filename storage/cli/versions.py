"""`vlod versions`: which versions a store has, what was changed from one to the next, and what each takes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import click

from storage.cli.text import Section, say
from storage.shards.files import Files
from storage.shards.manifest import Manifest
from storage.versions import Versions, current_manifest, find_versions


@click.command(epilog="Example: vlod versions ship.store", no_args_is_help=True)
@click.argument("store")
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
def versions(store: str, as_json: bool) -> None:
    """List the versions of STORE (a folder or a URL), the oldest first, and the bytes that each takes.

    Exits with 1 if the manifest of one is damaged.
    """
    files = Files(store)
    found = find_versions(files, current_manifest(files))
    facts = collect(files.url, found)
    say(facts, sections(facts), as_json=as_json)
    if found.damaged:
        click.get_current_context().exit(1)


def collect(url: str, found: Versions) -> dict[str, Any]:
    """All facts about a store's versions, as JSON holds them; sizes in bytes."""
    rows = []
    former: Manifest | None = None
    for number, manifest in found.manifests.items():
        shards, before = ({} if one is None else _bytes_of_shards(one) for one in (manifest, former))
        shared = sum(size for name, size in shards.items() if name in before)
        rows.append(
            {
                "version": number,
                "current": number == found.current.version,
                "triangles": manifest.model.triangles,
                "cells": manifest.counts.get("computed_cells", 0),
                "model_changed": former is not None and manifest.model.digest != former.model.digest,
                "parameters_changed": {} if former is None else _changed(former, manifest),
                "bytes": sum(shards.values()),
                "own_bytes": sum(shards.values()) - shared,
                "shared_bytes": shared,
            }
        )
        former = manifest
    return {
        "store": url,
        "current": found.current.version,
        "bytes": sum(shard.bytes for shard in found.shards().values()),
        "versions": rows,
        "problems": [found.damaged[number] for number in sorted(found.damaged)],
    }


def sections(facts: dict[str, Any]) -> list[Section]:
    """The facts of `collect`, as text for people."""
    rows = facts["versions"]
    heads = ("version", "triangles", "cells", "bytes", "of its own", "shared with the one before")
    table = [
        (
            f"{row['version']} (current)" if row["current"] else str(row["version"]),
            *(f"{row[name]:,}" for name in ("triangles", "cells", "bytes", "own_bytes", "shared_bytes")),
        )
        for row in rows
    ]
    changes = [(f"version {row['version']}", _change(row)) for row in rows[1:]]
    problems = [("", problem) for problem in facts["problems"]]
    return [
        Section(f"{facts['store']}  ({facts['bytes']:,} bytes in shards)", heads, table),
        *([Section("Changed from the one before", (), changes)] if changes else []),
        *([Section("Damaged", (), problems)] if problems else []),
    ]


def _bytes_of_shards(manifest: Manifest) -> dict[str, int]:
    """The length of each of a version's shards, by name."""
    return {shard.name: shard.bytes for _, shard in manifest.shards()}


def _changed(before: Manifest, after: Manifest) -> dict[str, Sequence[Any]]:
    """The parameters that differ, each with its two values; what one of the two does not know is None there."""
    names = sorted({*before.parameters, *after.parameters})
    pairs = {name: (before.parameters.get(name), after.parameters.get(name)) for name in names}
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}


def _change(row: dict[str, Any]) -> str:
    """What was changed, in words."""
    said = ["the model"] if row["model_changed"] else []
    said += [f"{name} from {_value(old)} to {_value(new)}" for name, (old, new) in row["parameters_changed"].items()]
    return ", ".join(said) or "neither the model nor parameters"


def _value(value: Any) -> str:
    return "none" if value is None else str(value)
