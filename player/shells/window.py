"""The window: fly and walk through a store with keys and mouse, see what it costs, record and replay paths."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from player.camera.controls import Camera
from player.camera.path import CameraPath, write_path
from player.camera.view import Vector, View, up_vector
from player.colours import COLOURS, COLOURS_SHOW
from player.errors import GraphicsError
from player.renderer.context import abilities
from player.renderer.target import Target
from player.renderer.text import TextOverlay
from player.scene import Scene
from player.shells.headless import Screen, near_and_far, save
from player.walkthrough import STRATEGIES, FrameStatistics, Settings, Walkthrough

_HELP = (
    ("W A S D", "move"),
    ("E  Q", "up, down"),
    ("drag", "look around (M: look without dragging)"),
    ("wheel", "speed (hold shift: four times)"),
    ("G", "walk or fly"),
    ("1  2  3", "strategy: vlod, frustum, none"),
    ("+  -", "allowed error in pixels (also page up, page down)"),
    ("F", "freeze culling"),
    ("C", "colours: the model's, by object, by level"),
    ("P", "screenshot"),
    ("R  T", "record a path; replay it"),
    ("O  H", "statistics; this help"),
    ("Esc", "quit"),
)

_RADIANS_PER_PIXEL = 0.004

#: Height of a walker's knees, as a part of the eyes' height: what is lower is stepped on, what is higher is in the way.
_KNEE = 0.35


@dataclass(frozen=True)
class WindowOptions:
    """What a window starts with."""

    screen: Screen
    path: CameraPath  # the first pose is where to begin; T replays it
    replay: bool  # begin by replaying the path
    output: Path  # directory of screenshots and recorded paths
    eye_height: float  # of walking, in model units


class Viewer:
    """A walkthrough in a window of moderngl-window. `step` draws one frame."""

    def __init__(self, window: Any, scene: Scene, settings: Settings, options: WindowOptions) -> None:
        """window: a moderngl_window BaseWindow."""
        self.window = window
        self.options = options
        self.context = window.ctx
        self.able = abilities(self.context, force_gl33=options.screen.force_gl33)
        self.scene = scene
        self.walk = Walkthrough(scene, self.context, self.able, settings)
        self.overlay = TextOverlay(self.context)
        self.target = self._make_target()
        self.probe = Target(self.context, (8, 8), samples=0, reversed_depth=self.able.reversed_depth)
        self.statistics: FrameStatistics | None = None
        self.show_statistics = True
        self.show_help = False
        self.message = "H: help"
        self.recorded: CameraPath | None = options.path if len(options.path) > 1 else None
        position, orientation = options.path.pose(0)
        up = scene.store.manifest.model.up
        self.camera = Camera(np.array(position), 0.0, 0.0, up, speed=2 * options.eye_height)
        self.camera.look_at(position, orientation)
        self._recording: list[tuple[float, np.ndarray, np.ndarray]] | None = None
        self._replaying: float | None = 0.0 if options.replay else None
        self._clock = 0.0
        self._milliseconds = 0.0
        self._connect()

    def step(self, seconds: float) -> FrameStatistics:
        """Moves by what happened in the last `seconds` and draws one frame into the window."""
        self._clock += seconds
        self._move(seconds)
        if self.target.size != tuple(self.window.buffer_size):
            self.target.release()
            self.target = self._make_target()
        view = self.view()
        statistics = self.walk.frame(view, self.target)
        self.statistics = statistics
        self._milliseconds += 0.1 * (1000 * seconds - self._milliseconds)
        self.context.copy_framebuffer(self.window.fbo, self.target.resolved)
        if self.show_statistics:
            self.overlay.draw(self._statistics_rows(statistics), self.window.fbo, self.target.size, "top left")
        if self.show_help:
            self.overlay.draw(_HELP, self.window.fbo, self.target.size, "bottom right")
        if self.message or statistics.absent:
            message = f"{self.walk.packs.pending} packs to come ..." if statistics.absent else self.message
            self.overlay.draw([(message,)], self.window.fbo, self.target.size, "bottom left")
        return statistics

    def view(self) -> View:
        """What the camera sees."""
        near, far = near_and_far(self.scene, self.camera.position, self.able)
        width, height = self.target.size
        field = self.options.screen.field_of_view
        return View(self.camera.position.copy(), self.camera.orientation, field, width, height, near, far)

    def on_key(self, key: Any, action: Any, modifiers: Any) -> None:
        """A key went down or up."""
        keys = self.window.keys
        self._hold("fast", bool(modifiers.shift))
        held = self._moves.get(key)
        if held is not None:
            self._hold(held, action == keys.ACTION_PRESS)
            if action == keys.ACTION_PRESS:
                self._replaying = None
        elif action == keys.ACTION_PRESS:
            do = self._actions.get(key)
            if do is not None:
                do()

    def on_drag(self, _x: int, _y: int, dx: int, dy: int) -> None:
        """The mouse moved with a button down."""
        self.camera.turn(dx * _RADIANS_PER_PIXEL, -dy * _RADIANS_PER_PIXEL)

    def on_move(self, _x: int, _y: int, dx: int, dy: int) -> None:
        """The mouse moved with no button down."""
        if self.window.mouse_exclusivity:
            self.camera.turn(dx * _RADIANS_PER_PIXEL, -dy * _RADIANS_PER_PIXEL)

    def on_scroll(self, _dx: float, dy: float) -> None:
        """The wheel turned."""
        self.camera.faster(dy)
        self.message = f"speed {self.camera.speed:.3g} units/s"

    def screenshot(self) -> Path:
        """Saves the picture, without the text over it."""
        file = _free_name(self.options.output, "vlod_screenshot_{:04d}.png")
        save(file, self.target.read())
        self.message = f"saved {file}"
        return file

    def record(self) -> None:
        """Begins to record a path, or ends it and saves it."""
        if self._recording is None:
            self._recording = []
            self.message = "recording; R: stop"
            return
        poses, self._recording = self._recording, None
        if len(poses) < 2:
            self.message = "nothing was recorded"
            return
        times, positions, orientations = (np.array(column) for column in zip(*poses, strict=True))
        self.recorded = CameraPath(times - times[0], positions, orientations)
        file = _free_name(self.options.output, "vlod_path_{:04d}.json")
        write_path(file, self.recorded)
        self.message = f"saved {file}; T: replay it"

    def replay(self) -> None:
        """Begins or ends the replay of the recorded path."""
        if self._replaying is not None:
            self._replaying = None
        elif self.recorded is None:
            self.message = "nothing to replay: record a path with R"
        else:
            self._replaying = 0.0
            self.message = "replaying; T: stop"

    def close(self) -> None:
        """Stops the threads and frees the GPU."""
        self.walk.close()
        self.overlay.release()
        self.target.release()
        self.probe.release()

    def _connect(self) -> None:
        window, keys = self.window, self.window.keys
        window.key_event_func = self.on_key
        window.mouse_drag_event_func = self.on_drag
        window.mouse_position_event_func = self.on_move
        window.mouse_scroll_event_func = self.on_scroll
        window.exit_key = None
        self._moves: dict[Any, str] = {
            keys.W: "forward", keys.S: "back", keys.A: "left", keys.D: "right", keys.E: "up", keys.Q: "down",
        }  # fmt: skip
        self._actions: dict[Any, Callable[[], object]] = {
            keys.NUMBER_1: lambda: self._use(0),
            keys.NUMBER_2: lambda: self._use(1),
            keys.NUMBER_3: lambda: self._use(2),
            keys.EQUAL: lambda: self._change_error(1.25),
            keys.PAGE_UP: lambda: self._change_error(1.25),
            keys.MINUS: lambda: self._change_error(0.8),
            keys.PAGE_DOWN: lambda: self._change_error(0.8),
            keys.F: self._freeze,
            keys.C: self._next_colours,
            keys.G: self._toggle_walking,
            keys.H: self._toggle_help,
            keys.M: self._toggle_mouse,
            keys.O: self._toggle_statistics,
            keys.P: self.screenshot,
            keys.R: self.record,
            keys.T: self.replay,
            keys.ESCAPE: window.close,
        }

    def _make_target(self) -> Target:
        return Target(
            self.context,
            tuple(self.window.buffer_size),
            samples=self.options.screen.samples,
            reversed_depth=self.able.reversed_depth,
        )

    def _move(self, seconds: float) -> None:
        camera = self.camera
        if self._replaying is not None and self.recorded is not None:
            self._replaying += seconds
            start = float(self.recorded.times[0])
            camera.look_at(*self.recorded.at(start + self._replaying))
            if self._replaying >= self.recorded.duration:
                self._replaying = None
                self.message = "replayed; T: again"
        else:
            motion = camera.motion(min(seconds, 0.1))
            camera.position = camera.position + (self._unhindered(motion) if camera.walking else motion)
            if camera.walking:
                self._stand(min(seconds, 0.1))
        if self._recording is not None and (not self._recording or self._clock > self._recording[-1][0]):
            self._recording.append((self._clock, camera.position.copy(), camera.orientation))

    def _unhindered(self, motion: Vector) -> Vector:
        """The part of a motion (3,) that walls and furniture allow: what is in the way of eyes or knees stops it."""
        length = float(np.sqrt((motion * motion).sum()))
        if length == 0:
            return motion
        up, eyes = up_vector(self.camera.up), self.options.eye_height
        heights = [self.camera.position, self.camera.position - (1 - _KNEE) * eyes * up]
        free = min(self.walk.distance(height, motion / length, up, self.probe) for height in heights)
        return motion * max(0.0, min(length, free - 0.2 * eyes)) / length

    def _stand(self, seconds: float) -> None:
        """Keeps the eyes above the floor; they rise by more than a step only where there is room overhead."""
        camera, eyes, up = self.camera, self.options.eye_height, up_vector(self.camera.up)
        floor = self.walk.distance(camera.position, -up, camera.forward, self.probe)
        if floor < (1 - _KNEE) * eyes:
            overhead = self.walk.distance(camera.position, up, camera.forward, self.probe)
            if floor + overhead < 1.1 * eyes:
                return
        camera.stand(floor, eyes, seconds)

    def _hold(self, name: str, down: bool) -> None:
        if down:
            self.camera.held.add(name)
        else:
            self.camera.held.discard(name)

    def _use(self, number: int) -> None:
        self.walk.use_strategy(STRATEGIES[number])
        self.message = f"strategy {STRATEGIES[number]}"

    def _change_error(self, factor: float) -> None:
        strategy = self.walk.strategy
        strategy.pixel_error = min(64.0, max(0.125, strategy.pixel_error * factor))
        self.message = f"allowed error {strategy.pixel_error:.2f} pixels"

    def _next_colours(self) -> None:
        following = COLOURS[(COLOURS.index(self.walk.colours) + 1) % len(COLOURS)]
        self.walk.use_colours(following)
        self.message = f"colours: {COLOURS_SHOW[following]}"

    def _freeze(self) -> None:
        self.walk.frozen = self.view() if self.walk.frozen is None else None
        self.message = "culling is frozen; F: go on" if self.walk.frozen else "culling follows the view"

    def _toggle_walking(self) -> None:
        self.camera.walking = not self.camera.walking
        self.message = "walking" if self.camera.walking else "flying"

    def _toggle_help(self) -> None:
        self.show_help = not self.show_help

    def _toggle_statistics(self) -> None:
        self.show_statistics = not self.show_statistics

    def _toggle_mouse(self) -> None:
        self.window.mouse_exclusivity = not self.window.mouse_exclusivity

    def _statistics_rows(self, s: FrameStatistics) -> list[tuple[str, str]]:
        source = "vLOD" if s.computed else ("run time" if s.strategy == "vlod" else s.strategy)
        cell = "none" if s.cell < 0 else str(s.cell)
        total = self.scene.store.manifest.model.triangles
        milliseconds = max(self._milliseconds, 1e-3)
        return [
            ("frames/s", f"{1000 / milliseconds:.0f}  ({s.frame_ms:.1f} ms, {s.cpu_ms:.1f} ms CPU)"),
            ("strategy", f"{s.strategy}{' (frozen)' if self.walk.frozen else ''}, cell {cell}, from {source}"),
            ("allowed error", f"{self.walk.strategy.pixel_error:.2f} pixels"),
            ("triangles", f"{s.triangles:,} of {total:,} ({100 * s.triangles / max(total, 1):.1f} %)"),
            ("turned away", f"{s.turned_triangles:,} triangles left out"),
            ("drawables", f"{s.drawables:,} in {s.draw_calls} draw calls"),
            ("on the GPU", f"{s.cache_bytes / 1e6:.1f} MB, {self.walk.packs.pending} packs to come"),
            ("fetched", f"{s.bytes_fetched / 1e6:.1f} MB"),
            ("stand-ins", f"{s.replaced:,} other levels, {s.absent:,} not there yet"),
            ("moving", f"{'walking' if self.camera.walking else 'flying'} at {self.camera.speed:.3g} units/s"),
        ]


def open_window(screen: Screen, title: str) -> Any:
    """A new window of moderngl-window. Raises GraphicsError where there is no display or no OpenGL 3.3."""
    cure = "use --headless to render without a window"
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise GraphicsError(f"there is no display to open a window on: {cure}")
    try:
        import moderngl_window

        window_class = moderngl_window.get_local_window_cls("pyglet")
        window = window_class(
            title=title, size=(screen.width, screen.height), gl_version=(3, 3), resizable=True, vsync=True
        )
    except ImportError as error:
        raise GraphicsError(f"the window needs a library that is not there ({error}): {cure}") from None
    except Exception as error:  # pyglet and moderngl raise many kinds
        reason = " ".join(str(error).split()) or type(error).__name__
        raise GraphicsError(f"no window could be opened ({reason}): {cure}") from None
    window.swap_buffers()
    return window


def run(scene: Scene, settings: Settings, options: WindowOptions) -> None:
    """Opens a window and plays until it is closed."""
    window = open_window(options.screen, "vLOD")
    viewer = Viewer(window, scene, replace(settings, wait=False), options)
    last = time.perf_counter()
    try:
        while not window.is_closing:
            now = time.perf_counter()
            viewer.step(now - last)
            last = now
            window.swap_buffers()
    finally:
        viewer.close()
        window.destroy()


def _free_name(directory: Path, pattern: str) -> Path:
    directory.mkdir(parents=True, exist_ok=True)
    number = 1
    while (directory / pattern.format(number)).exists():
        number += 1
    return directory / pattern.format(number)
