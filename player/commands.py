"""The player's commands: `vlod play` and `vlod path`. Thin; what they need is imported when they run."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from player import colouring
from player.options import Drawing, GroupedCommand, Headless, InWindow, Loading, Picture, Way, options_of, taken

if TYPE_CHECKING:
    from player.shells.headless import Report, Screen
    from player.shown_model import ShownModel
    from player.walkthrough import Settings


@options_of(Drawing, Way, Picture, Loading, Headless, InWindow)
@click.command(
    cls=GroupedCommand,
    no_args_is_help=True,
    epilog="""\b
Examples:
  vlod play plant.store
  vlod play plant.store --headless --frames frames --report report.json
  vlod play plant.store --headless --path tour.json --frames frames --compare none
  vlod play plant.store --headless --colours objects --frames frames""",
)
@click.argument("store")
@click.pass_context
def play(context: click.Context, /, store: str, **values: Any) -> None:
    """Walk through a STORE (a directory or URL), in a window or headless.

    In the window, press H for the keys. Where no cells were computed, the model is culled at run time. What cannot be
    read is said, stood in for by other levels, and tried again.
    """
    drawing, way, headless = taken(Drawing, values), taken(Way, values), taken(Headless, values)
    headless.check()
    if headless.compare and drawing.colours != colouring.COLOURINGS[0].name:
        raise click.UsageError("--compare compares the model's own colours: leave --colours out")
    from player.camera.path import read_path
    from player.shown_model import shown_model
    from player.tour.survey import survey
    from player.tour.tour import make_tour
    from storage.base.errors import StoreError
    from storage.store import open_store

    path = read_path(way.path_file) if way.path_file is not None else None
    loading = taken(Loading, values)
    settings = _settings(drawing, loading)
    _tell_of_compiling(context)
    opened = open_store(store, tell=_tell, cache_dir=loading.cache_dir, cache_bytes=loading.cache_bytes)
    model = shown_model(opened)
    screen = _screen(model, taken(Picture, values))
    make = partial(make_tour, model, frames=way.tour_frames, seed=0, kind=way.tour)
    if headless.headless:
        try:
            with model.store.files.patient(_tell):
                path = path or make(survey(model))
        except StoreError as error:  # only the tour needs what cannot be had
            raise StoreError(f"{error}, or give a --path") from error
        if headless.fps is not None:
            path = path.resampled(headless.fps)
        if not _play_headless(model, path, screen, settings, headless):
            context.exit(1)
        return
    from player.shells.window import WindowOptions, run

    with model.store.files.patient(_tell):
        known = survey(model)
        first = path or make(known)
    options = WindowOptions(
        screen=screen,
        path=first,
        replay=path is not None,
        output=taken(InWindow, values).output,
        eye_height=known.eye_height,
    )
    run(model, settings, options)


@click.command(no_args_is_help=True, epilog="Example: vlod path plant.store -o tour.json --frames 240")
@click.argument("store")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path, dir_okay=False), help="File to write. Default: standard output."
)
@click.option("--frames", type=click.IntRange(1), default=120, show_default=True, help="Poses, 25 a second.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Another number, another tour.")
@Way.KIND
@click.pass_context
def path(context: click.Context, /, store: str, output: Path | None, frames: int, seed: int, tour: str | None) -> None:
    """Make an automatic tour through a STORE, as a path file for `vlod play --path`.

    The tour keeps clear of surfaces, stays in computed cells where there are any, and looks ahead.
    """
    from player.camera.path import path_text, write_path
    from player.shown_model import shown_model
    from player.tour.survey import survey
    from player.tour.tour import make_tour
    from storage.store import open_store

    _tell_of_compiling(context)
    model = shown_model(open_store(store, tell=_tell))
    with model.store.files.patient(_tell):
        made = make_tour(model, survey(model), frames=frames, seed=seed, kind=tour)
    if output is None:
        click.echo(path_text(made), nl=False)
    else:
        write_path(output, made)
        click.echo(f"{output}: {len(made)} poses, {made.duration:.1f} s, {made.length:.6g} model units")


def _tell_of_compiling(context: click.Context) -> None:
    """Says on standard error why a machine's first run takes so long, should it."""
    from storage.base.compiling import WhenLong, listening, notice

    context.with_resource(listening(WhenLong(partial(click.echo, notice("a minute"), err=True))))


def _tell(line: str) -> None:
    """Says on standard error what is waited for."""
    click.echo(line, err=True)


def _settings(drawing: Drawing, loading: Loading) -> Settings:
    from player.walkthrough import Settings

    return Settings(
        strategy=drawing.strategy,
        pixel_error=drawing.pixel_error,
        cache_bytes=loading.cache,
        threads=loading.threads,
        wait=loading.wait,
        prefetch=loading.prefetch,
        fog=drawing.fog,
        colours=drawing.colours,
    )


def _screen(model: ShownModel, picture: Picture) -> Screen:
    from player.shells.headless import Screen

    field = picture.field_of_view or float(model.store.manifest.parameters.get("field_of_view", 60.0))
    return Screen(*picture.size, field, int(picture.samples), picture.gl33)


def _play_headless(model: ShownModel, path: Any, screen: Screen, settings: Settings, headless: Headless) -> bool:
    """Renders, writes and prints what was asked for; False if a picture is not what it should be."""
    from player.shells.headless import play as render_path
    from player.shells.headless import write_report
    from storage.base.progress import progress_for

    with progress_for() as progress:
        report = render_path(
            model,
            path,
            screen,
            settings,
            frames=headless.frames,
            compare=headless.compare is not None,
            progress=progress,
        )
    if headless.report is not None:
        write_report(headless.report, report)
    totals = report.content["totals"]
    if totals["troubles"]:
        said = "; ".join(totals["troubles"][:3])
        click.echo(f"{totals['lacking_frames']} frames lack what cannot be read: {said}", err=True)
    if not settings.wait and totals["absent_frames"]:
        click.echo(
            f"{totals['absent_frames']} of {totals['frames']} frames lack up to {totals['most_absent']} nodes that had "
            "not arrived: leave --no-wait out for whole ones",
            err=True,
        )
    if headless.as_json:
        summary = {key: report.content[key] for key in ("totals", "compare") if key in report.content}
        click.echo(json.dumps(summary, indent=1))
    else:
        _print_summary(report)
    return report.passed


def _print_summary(report: Report) -> None:
    content = report.content
    totals = content["totals"]
    click.echo(
        f"{totals['frames']} frames, {totals['computed_frames']} from computed cells: "
        f"{totals['triangles']['mean']:,.0f} triangles a frame of {content['model_triangles']:,}, "
        f"{totals['frame_ms']['median']:.1f} ms a frame, {totals['cpu_ms']['median']:.2f} ms of it choosing, "
        f"{totals['bytes_fetched'] / 1e6:.1f} MB fetched"
    )
    if totals["approximate_frames"]:
        click.echo(
            f"{totals['approximate_frames']} frames are approximate: their lists are carried over from the pixel error "
            "that the store was built for"
        )
    compared = content.get("compare")
    if compared is not None:
        click.echo(
            f"against the full model: {'passed' if compared['passed'] else 'FAILED'}; {_holes(compared)}; "
            f"at most {100 * compared['largest_differing']:.3f} % of a frame's pixels differ; the worst is "
            f"{_worst(content)}"
        )


def _holes(compared: dict[str, Any]) -> str:
    if not compared["holes"]:
        return "no hole"
    return (
        f"{compared['holes']:,} hole {'pixel' if compared['holes'] == 1 else 'pixels'} in "
        f"{compared['frames_with_holes']} of the frames, {compared['holes_in_a_million']:.2f} in a million that it "
        f"covers, of which {compared['allowed_in_a_million']:g} may be"
    )


def _worst(content: dict[str, Any]) -> str:
    """The worst frame, where the eye is in it, and the picture of what it lacks."""
    compared = content["compare"]
    row = content["frames"][compared["worst_frame"]]
    eye = ", ".join(f"{value:.6g}" for value in row["position"])
    holes = f" with {row['compare']['holes']:,} of the hole pixels" if row["compare"]["holes"] else ""
    picture = compared["images"].get("difference")
    return f"frame {row['index']}, seen from ({eye}){holes}" + (f": see {picture} among the frames" if picture else "")
