"""The player's commands: `vlod play` and `vlod path`. Thin; what they need is imported when they run."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any

import click

from storage.base.amounts import Bytes


class _Size(click.ParamType):
    """A picture's size, such as 1280x720."""

    name = "WxH"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        if isinstance(value, tuple):
            return value
        width, _, height = str(value).lower().partition("x")
        if not (width.isdecimal() and height.isdecimal() and 1 <= int(width) <= 16384 and 1 <= int(height) <= 16384):
            self.fail(f"{value!r} is not a size in pixels such as 1280x720 (at most 16384 either way)", param, ctx)
        return int(width), int(height)


@click.command(
    no_args_is_help=True,
    epilog="""\b
Examples:
  vlod play plant.store
  vlod play plant.store --headless --frames frames --report report.json
  vlod play plant.store --headless --path tour.json --frames frames --compare none
  vlod play plant.store --headless --colours objects --frames frames""",
)
@click.argument("store")
@click.option("--headless", is_flag=True, help="Render a path without a window, to files.")
@click.option(
    "--path",
    "path_file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Path file to follow. Default: an automatic tour.",
)
@click.option("--frames", type=click.Path(path_type=Path, file_okay=False), help="Headless: write PNG frames here.")
@click.option(
    "--report", type=click.Path(path_type=Path, dir_okay=False), help="Headless: write the report (JSON) here."
)
@click.option("--json", "as_json", is_flag=True, help="Headless: print the report's totals as JSON.")
@click.option(
    "--compare",
    type=click.Choice(["none"]),
    help="Headless: also render the full model (strategy none), compare each frame with it, and exit with 1 if a frame "
    "has a hole or if more than 1 % of its pixels differ by more than 16 levels.",
)
@click.option(
    "--tour-frames", type=click.IntRange(1), default=120, show_default=True, help="Frames of the automatic tour."
)
@click.option(
    "--fps", type=click.FloatRange(min=0.01), help="Headless: frames a second of the path. Default: its own poses."
)
@click.option(
    "--strategy",
    type=click.Choice(["vlod", "frustum", "none"]),
    default="vlod",
    show_default=True,
    help="What to draw: the cells' vLODs, culling at run time, or everything.",
)
@click.option(
    "--pixel-error",
    type=click.FloatRange(min=0, min_open=True),
    help="Allowed error in pixels of the screen that the store was built for. Default: as it was built.",
)
@click.option("--size", type=_Size(), default="1280x720", show_default=True, help="Of the picture, in pixels.")
@click.option(
    "--field-of-view",
    type=click.FloatRange(1, 170),
    help="Vertical, in degrees. Default: what the store was built for.",
)
@click.option("--samples", type=click.Choice(["0", "2", "4", "8"]), default="0", show_default=True, help="Per pixel.")
@click.option("--cache", type=Bytes(), default="1GiB", show_default=True, help="Budget of geometry on the GPU.")
@click.option("--threads", type=click.IntRange(1, 64), default=4, show_default=True, help="That load geometry.")
@click.option("--prefetch/--no-prefetch", default=True, show_default=True, help="Load ahead of the motion.")
@click.option(
    "--wait/--no-wait",
    default=True,
    show_default=True,
    help="Headless: frames wait for their geometry, so that pictures do not depend on the disk's or network's speed.",
)
@click.option(
    "--fog", type=click.FloatRange(min=0), default=0.0, show_default=True, help="Fade with distance, per model unit."
)
@click.option(
    "--colours",
    type=click.Choice(["model", "objects", "levels"]),
    default="model",
    show_default=True,
    help="objects: each object, and each node above them, in a colour of its own. levels: leaves from dark green "
    "(finest) to yellow, nodes above them from orange to blue (the root).",
)
@click.option("--gl33", is_flag=True, help="Use no more than OpenGL 3.3, as on old drivers.")
@click.option(
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path(),
    help="Window: directory of screenshots and recorded paths. Default: the current one.",
)
@click.pass_context
def play(context: click.Context, /, store: str, headless: bool, path_file: Path | None, **options: Any) -> None:
    """Walk through a STORE (a directory or URL), in a window or headless.

    In the window, press H for the keys. Where no cells were computed, the model is culled at run time.
    """
    from player.camera.path import read_path
    from player.scene import scene_of
    from player.tour.tour import make_tour, survey
    from player.walkthrough import Settings
    from storage.store import open_store

    _tell_of_compiling(context)
    scene = scene_of(open_store(store))
    path = read_path(path_file) if path_file is not None else None
    settings = Settings(
        strategy=options["strategy"],
        pixel_error=options["pixel_error"],
        cache_bytes=options["cache"],
        threads=options["threads"],
        wait=options["wait"],
        prefetch=options["prefetch"],
        fog=options["fog"],
        colours=options["colours"],
    )
    if headless:
        if not (options["frames"] or options["report"] or options["as_json"]):
            raise click.UsageError("nothing to do: give --frames DIR, --report FILE or --json")
        if options["compare"] and options["colours"] != "model":
            raise click.UsageError("--compare compares the model's own colours: leave --colours out")
        path = path or make_tour(scene, survey(scene), frames=options["tour_frames"], seed=0)
        if options["fps"] is not None:
            path = path.resampled(options["fps"])
        if not _play_headless(scene, path, settings, options):
            context.exit(1)
        return
    for name in ("frames", "report", "as_json", "compare", "fps"):
        if options[name]:
            raise click.UsageError(f"--{name.removeprefix('as_')} needs --headless")
    from player.shells.window import WindowOptions, run

    known = survey(scene)
    run(
        scene,
        settings,
        WindowOptions(
            screen=_screen(scene, options),
            path=path or make_tour(scene, known, frames=options["tour_frames"], seed=0),
            replay=path is not None,
            output=options["output"],
            eye_height=known.eye_height,
        ),
    )


@click.command(no_args_is_help=True, epilog="Example: vlod path plant.store -o tour.json --frames 240")
@click.argument("store")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path, dir_okay=False), help="File to write. Default: standard output."
)
@click.option("--frames", type=click.IntRange(1), default=120, show_default=True, help="Poses, 25 a second.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Another number, another tour.")
@click.pass_context
def path(context: click.Context, /, store: str, output: Path | None, frames: int, seed: int) -> None:
    """Make an automatic tour through a STORE, as a path file for `vlod play --path`.

    The tour keeps clear of surfaces, stays in computed cells where there are any, and looks ahead.
    """
    from player.camera.path import path_text, write_path
    from player.scene import scene_of
    from player.tour.tour import make_tour, survey
    from storage.store import open_store

    _tell_of_compiling(context)
    scene = scene_of(open_store(store))
    tour = make_tour(scene, survey(scene), frames=frames, seed=seed)
    if output is None:
        click.echo(path_text(tour), nl=False)
    else:
        write_path(output, tour)
        click.echo(f"{output}: {len(tour)} poses, {tour.duration:.1f} s, {tour.length:.6g} model units")


def _tell_of_compiling(context: click.Context) -> None:
    """Says on standard error why a machine's first run takes so long, should it."""
    from storage.base.compiling import WhenLong, listening, notice

    context.with_resource(listening(WhenLong(partial(click.echo, notice("a minute"), err=True))))


def _screen(scene: Any, options: dict[str, Any]) -> Any:
    from player.shells.headless import Screen

    field = options["field_of_view"] or float(scene.store.manifest.parameters.get("field_of_view", 60.0))
    width, height = options["size"]
    return Screen(width, height, field, int(options["samples"]), options["gl33"])


def _play_headless(scene: Any, path: Any, settings: Any, options: dict[str, Any]) -> bool:
    """Renders, writes and prints what was asked for; False if the comparison failed."""
    from player.shells.headless import play as render_path
    from player.shells.headless import write_report
    from storage.base.progress import progress_for

    with progress_for() as progress:
        report = render_path(
            scene,
            path,
            _screen(scene, options),
            settings,
            frames=options["frames"],
            compare=options["compare"] is not None,
            progress=progress,
        )
    if options["report"] is not None:
        write_report(options["report"], report)
    lacking, troubles = (report.content["totals"][key] for key in ("lacking_frames", "troubles"))
    if troubles:
        click.echo(f"{lacking} frames lack what cannot be read: {'; '.join(troubles[:3])}", err=True)
    summary = {key: report.content[key] for key in ("totals", "compare") if key in report.content}
    if options["as_json"]:
        click.echo(json.dumps(summary, indent=1))
    else:
        _print_summary(report.content)
    return report.passed


def _print_summary(content: dict[str, Any]) -> None:
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
            f"against the full model: {'passed' if compared['passed'] else 'FAILED'}; {compared['holes']} hole pixels; "
            f"at most {100 * compared['largest_differing']:.3f} % of a frame's pixels differ "
            f"(frame {compared['worst_frame']} is the worst)"
        )
