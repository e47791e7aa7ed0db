"""The job's commands: `vlod build`, `vlod verify`, `vlod gc`, `vlod demo-scene`, `vlod report`.

Thin: each reads its options, calls a function of this package, and prints what it returns. Heavy imports wait until a
command runs, so that help comes at once.
"""

from __future__ import annotations

import json
import signal
from pathlib import Path
from typing import Any

import click

from jobs.options import objects, running
from jobs.options.groups import SECTIONS
from jobs.options.sections import SectionedCommand
from jobs.scenes.kinds import KINDS
from storage.base.amounts import Bytes
from storage.base.errors import ParameterError


@click.command(
    cls=SectionedCommand,
    sections=(*SECTIONS, running.SECTION),
    epilog="Example: vlod build ship.glb ship.store --pixel-error 1 --triangles-per-cell 100000",
    no_args_is_help=True,
)
@click.argument("inputs", nargs=-1, metavar="INPUTS...", type=click.Path(path_type=Path))
@click.argument("store", type=click.Path(path_type=Path))
def build(
    inputs: tuple[Path, ...],
    store: Path,
    executor: str,
    workers: int | None,
    ray_address: str | None,
    memory: int,
    work: Path | None,
    report: Path | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Build a STORE from model files or folders (INPUTS).

    Finished tasks are kept: after an interrupt, a crash or a change, the same command goes on where it can.
    """
    from jobs.importing.inputs import total_bytes
    from jobs.parameters import BuildParameters
    from jobs.pipeline import build as build_store
    from jobs.running.choose_executor import AUTO_RAY_BYTES, choose_executor
    from storage.base.progress import progress_for

    if not inputs:
        named = f"{store} STORE" if store.is_file() else f"MODEL {store}"
        raise click.UsageError(f"two things must be named: `vlod build {named}`")
    if report is not None:
        report.parent.mkdir(parents=True, exist_ok=True)
    parameters = BuildParameters(**objects.filled_in(options))
    # What ends a job on a cluster is treated as the user's own interrupt: workers stop, what is finished is kept.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    chosen = choose_executor(executor, workers, ray_address, total_bytes(inputs, AUTO_RAY_BYTES))
    try:
        with progress_for() as progress:
            done = build_store(inputs, store, parameters, chosen, progress, work, memory)
    finally:
        chosen.close()
    if report is not None:
        report.write_text(done.to_text())
    if as_json:
        click.echo(done.to_text(), nl=False)
    else:
        for line in done.left_out():
            click.echo(line)
        click.echo(
            f"{store}: version {done.version}, {done.counts['computed_cells']} cells, "
            f"{done.counts['drawables']} drawables, {done.bytes['total'] / 1e6:.1f} MB, {done.seconds:.1f} s"
        )


@click.command(epilog="Example: vlod verify ship.store --cells 200 --samples 1000", no_args_is_help=True)
@click.argument("store")
@click.option(
    "--samples", type=click.IntRange(min=0), default=1000, show_default=True, help="Rays for each sampled cell."
)
@click.option(
    "--cells", type=click.IntRange(min=0), help="Cells to sample.  [default: a tenth of them, from 10 to 100]"
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the sampling.")
@click.option("--workers", type=click.IntRange(min=1), help="Processes that work.  [default: one for each core]")
@click.option(
    "--repair",
    is_flag=True,
    help="First make again what is bad or missing, of all versions, and nothing else: from the work directory, from "
    "--from, from --model, whichever has it.",
)
@click.option("--from", "source", metavar="STORE", help="For --repair: another copy of the store, a folder or a URL.")
@click.option(
    "--model",
    multiple=True,
    type=click.Path(path_type=Path),
    help="For --repair: what the store was built from; once for each file or folder.",
)
@click.option(
    "--work",
    type=click.Path(path_type=Path, file_okay=False),
    help="For --repair: the work directory of the store's builds. Default: STORE/work.",
)
@click.option(
    "--memory",
    type=Bytes(),
    metavar="SIZE",
    default="2GiB",
    show_default=True,
    help="For --repair with --model: what one task may need, as the build was allowed.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the report as JSON.")
@click.pass_context
def verify(
    context: click.Context,
    store: str,
    samples: int,
    cells: int | None,
    seed: int,
    workers: int | None,
    repair: bool,
    source: str | None,
    model: tuple[Path, ...],
    work: Path | None,
    memory: int,
    as_json: bool,
) -> None:
    """Check a STORE: every byte, every change between cells, its cells against rays. Exits with 1 if it fails."""
    from jobs.checking.verify import verify as verify_store
    from jobs.upkeep.repair import repair as repair_store
    from storage.base.errors import CorruptStoreError
    from storage.base.progress import progress_for

    if not repair and (source or model or work):
        raise click.UsageError("--from, --model and --work say what --repair may use: give that, too")
    repairs: dict[str, Any] = {}
    try:
        with progress_for() as progress:
            if repair:
                done = repair_store(
                    store, source=source, model=model, work=work, workers=workers, memory=memory, progress=progress
                )
                repairs = {"repairs": done.to_json()}
            report = verify_store(store, samples=samples, cells=cells, seed=seed, workers=workers, progress=progress)
    except CorruptStoreError as error:
        # Its manifest is damaged, so there is no telling what it is: for this command a failed check, not wrong usage.
        click.echo(json.dumps({"store": store, "ok": False, "problems": [str(error)]}, indent=1) if as_json else error)
        context.exit(1)
    if as_json:
        click.echo(json.dumps({**report.to_json(), **repairs}, indent=1))
    else:
        if repair:
            _print_repairs(repairs["repairs"])
        _print_verification(report.to_json())
    if not report.ok:
        context.exit(1)


@click.command(epilog="Example: vlod gc ship.store --keep 2 --dry-run", no_args_is_help=True)
@click.argument("store")
@click.option("--keep", type=click.IntRange(min=1), metavar="N", help="Keep the N newest versions.  [default: all]")
@click.option("--keep-versions", metavar="N,N...", help="Keep these versions, and the current one.")
@click.option(
    "--work",
    type=click.Path(path_type=Path, file_okay=False),
    help="Work directory of this store's builds, and of no other's. Default: STORE/work.",
)
@click.option("--dry-run", is_flag=True, help="Only say what would go, and the bytes that this frees.")
@click.option("--json", "as_json", is_flag=True, help="Print what goes as JSON.")
def gc(
    store: str, keep: int | None, keep_versions: str | None, work: Path | None, dry_run: bool, as_json: bool
) -> None:
    """Remove from STORE the versions that are not kept, and all that no kept version needs.

    That is shards, leftovers of killed builds, and finished tasks: also those of a build that was interrupted, which
    then begins anew. Whoever reads a kept version is not disturbed; while a build runs nothing is removed.
    """
    from jobs.upkeep.garbage import collect_garbage

    kept_versions = None if keep_versions is None else _numbers("--keep-versions", keep_versions)
    garbage = collect_garbage(store, keep=keep, keep_versions=kept_versions, work=work, dry_run=dry_run)
    found = garbage.to_json()
    if as_json:
        click.echo(json.dumps({**found, "dry_run": dry_run}, indent=1))
        return
    kept, dropped = (", ".join(map(str, numbers)) or "none" for numbers in (garbage.kept, garbage.dropped))
    goes = ", ".join(f"{found[kind]['count']:,} {kind}" for kind in ("shards", "results", "leftovers"))
    click.echo(
        f"{store}: versions kept: {kept}; dropped: {dropped}; {'would remove' if dry_run else 'removed'} {goes}: "
        f"{garbage.bytes:,} bytes"
    )


@click.command(
    "demo-scene", epilog="Example: vlod demo-scene plant plant.glb --triangles 1000000", no_args_is_help=True
)
@click.argument("kind", type=click.Choice(tuple(KINDS)))
@click.argument("out", type=click.Path(path_type=Path))
@click.option("--triangles", type=int, default=300_000, show_default=True, help="Size of the scene, instances counted.")
@click.option("--seed", type=int, default=0, show_default=True, help="Another seed, another scene.")
@click.option("--json", "as_json", is_flag=True, help="Print what was written as JSON.")
def demo_scene(kind: str, out: Path, triangles: int, seed: int, as_json: bool) -> None:
    """Generate a model of a given KIND and size, as binary glTF (OUT, a .glb)."""
    from jobs.scenes import write_scene
    from storage.base.progress import progress_for

    with progress_for() as progress:
        progress.start(kind)
        scene = write_scene(kind, out, triangles, seed, progress.update)
        progress.finish(f"{scene.triangles:,} triangles")
    if as_json:
        numbers = ("triangles", "unique_triangles", "nodes", "meshes", "bytes")
        content = {"kind": kind, "seed": seed, **{name: int(getattr(scene, name)) for name in numbers}}
        click.echo(json.dumps(content, indent=1))
    else:
        click.echo(f"{out}: {scene.triangles:,} triangles, {scene.bytes / 1e6:.1f} MB")


@click.command(epilog="Example: vlod report demo", no_args_is_help=True)
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False))
def report(folder: Path) -> None:
    """Make one page, report.html, and a short film of the reports and frames in FOLDER (see deploy/demo.sh).

    Reads build.json, verify.json, play.json, further play-*.json for comparison, and frames/.
    """
    from jobs.report.page import write_page

    page = write_page(folder)
    click.echo(f"{page}: {page.stat().st_size / 1e6:.1f} MB")


def _numbers(option: str, text: str) -> list[int]:
    """The numbers that an option lists, with commas between them. Raises ParameterError."""
    try:
        return [int(number) for number in text.split(",")]
    except ValueError:
        raise ParameterError(f"{option} wants numbers with commas between them, such as 3,5, not {text!r}") from None


def _print_verification(report: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    from storage.cli.text import MAY_MISS

    table = Table(title=report["store"], show_header=False)
    table.add_row("cells", f"{report['cells']:,}")
    if report["unreadable_cells"]:
        table.add_row("cells in damaged shards", f"{report['unreadable_cells']:,}")
    table.add_row("cells read again", f"{report['read_cells']:,}")
    table.add_row("cells sampled", f"{report['sampled_cells']:,}")
    table.add_row("rays", f"{report['rays']:,}")
    table.add_row("missed drawables", f"{report['missed']:,}")
    table.add_row("missed pixels", _chance(report["missed_rays"], report["uniform_rays"]))
    if report["approximation"]:
        table.add_row("missed pixels, as stored", _chance(report["stored_missed_rays"], report["stored_rays"]))
    for unit, value in report["tightness"].items():
        table.add_row(f"reported / seen {unit}", "-" if value is None else f"{value:.2f}")
    table.add_row("seconds", f"{report['seconds']:.1f}")
    console = Console()
    console.print(table)
    for problem in report["problems"]:
        console.print(f"[red]{problem}[/red]", highlight=False, soft_wrap=True)
    if report["problems_untold"]:
        console.print(f"and {report['problems_untold']} more")
    verdict = "sound" if report["ok"] else "NOT sound"
    if report["approximation"]:
        verdict += "; " + MAY_MISS.format(report["approximation"])
    console.print(verdict, soft_wrap=True)


def _print_repairs(repairs: dict[str, Any]) -> None:
    for row in repairs["mended"]:
        click.echo(f"mended {row['file']} from {row['source']}")
    for line in repairs["left"]:
        click.echo(line)
    if not repairs["mended"] and not repairs["left"]:
        click.echo("nothing to mend")


def _chance(missed: int, rays: int) -> str:
    """A share of rays, and of how many."""
    return f"{missed / rays:.2g} ({missed:,} of {rays:,} rays)" if rays else "-"
