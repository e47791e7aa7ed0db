"""The window: fly and walk through a store with keys and mouse, see what it costs, record and replay paths."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from player import colouring
from player.camera import steering
from player.camera.camera import FAST, Camera
from player.camera.path import CameraPath
from player.camera.steering.steering import Steering
from player.camera.view import Vector, View
from player.errors import GraphicsError
from player.offers import Offer, named, names
from player.renderer.context import abilities
from player.renderer.targets.target import Target
from player.renderer.text import TextOverlay
from player.shells.free_name import free_name
from player.shells.head_up_display import Situation, message_rows, statistics_rows
from player.shells.headless import Screen, near_and_far, save
from player.shells.keys import HELD, help_rows, key_table
from player.shells.recorder import Recorder
from player.shown_model import ShownModel
from player.walkthrough import FrameStatistics, Settings, Walkthrough
from storage.base.errors import VlodError

_RADIANS_PER_PIXEL = 0.004

#: The longest time that one step may move by, in seconds: after a stall nobody is somewhere else.
_LONGEST_STEP = 0.1

#: Errors in pixels between which the keys change what is allowed.
_LEAST_ERROR, _MOST_ERROR = 0.125, 64.0


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

    def __init__(self, window: Any, model: ShownModel, settings: Settings, options: WindowOptions) -> None:
        """window: a moderngl_window BaseWindow."""
        self.window = window
        self.options = options
        self.context = window.ctx
        self.able = abilities(self.context, force_gl33=options.screen.force_gl33)
        self.model = model
        self.walk = Walkthrough(model, self.context, self.able, settings)
        self.overlay = TextOverlay(self.context)
        self.target = self._make_target()
        self.probe = Target(self.context, (8, 8), samples=0, reversed_depth=self.able.reversed_depth)
        self.statistics: FrameStatistics | None = None
        self.show_statistics = True
        self.show_help = False
        self.message = "H: help"
        position, orientation = options.path.pose(0)
        up = model.store.manifest.model.up
        self.camera = Camera(np.array(position), 0.0, 0.0, up, speed=2 * options.eye_height)
        self.camera.look_at(position, orientation)
        self.recorder = Recorder(options.output, options.path, replay=options.replay)
        self._use_steering(steering.STEERINGS[0])
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
        self.statistics = self.walk.frame(self.view(), self.target)
        self._milliseconds += 0.1 * (1000 * seconds - self._milliseconds)
        self.context.copy_framebuffer(self.window.fbo, self.target.resolved)
        self._write_over(self.statistics)
        return self.statistics

    def view(self) -> View:
        """What the camera sees."""
        near, far = near_and_far(self.model, self.camera.position, self.able)
        width, height = self.target.size
        field = self.options.screen.field_of_view
        return View(self.camera.position.copy(), self.camera.orientation, field, width, height, near, far)

    def distance(self, position: Vector, direction: Vector, up: Vector) -> float:
        """See player.camera.steering.steering.Surroundings: to what is drawn."""
        return self.walk.distance(position, direction, up, self.probe)

    def on_key(self, key: Any, action: Any, modifiers: Any) -> None:
        """A key went down or up."""
        pressed = action == self.window.keys.ACTION_PRESS
        self.camera.hold(FAST, bool(modifiers.shift))
        held = self._held.get(key)
        if held is not None:
            self.camera.hold(held, pressed)
            if pressed:
                self.recorder.stop_replay()
        elif pressed and key in self._actions:
            try:
                self._actions[key](self)
            except (VlodError, OSError) as error:  # what cannot be written: no reason to close the window
                self.message = str(error)

    def on_drag(self, _x: int, _y: int, dx: int, dy: int) -> None:
        """The mouse moved with a button down."""
        self._steering.turn(self.camera, dx * _RADIANS_PER_PIXEL, -dy * _RADIANS_PER_PIXEL)

    def on_move(self, _x: int, _y: int, dx: int, dy: int) -> None:
        """The mouse moved with no button down."""
        if self.window.mouse_exclusivity:
            self.on_drag(_x, _y, dx, dy)

    def on_scroll(self, _dx: float, dy: float) -> None:
        """The wheel turned."""
        self.camera.faster(dy)
        self.message = f"speed {self.camera.speed:.3g} units/s"

    def use_strategy(self, name: str) -> None:
        """Draws by another of player.strategies."""
        self.walk.use_strategy(name)
        self.message = f"strategy {name}"

    def use_next_colours(self) -> None:
        """Shows by colours what comes next in player.colouring."""
        following = _after(colouring.COLOURINGS, self.walk.colours)
        self.walk.use_colours(following.name)
        self.message = f"colours: {following.shows}"

    def use_next_steering(self) -> None:
        """Moves in the way that comes next in player.camera.steering."""
        following = _after(steering.STEERINGS, self.steering_name)
        self._use_steering(following)
        self.message = following.shows

    def change_error(self, factor: float) -> None:
        """Multiplies the allowed error in pixels."""
        strategy = self.walk.strategy
        strategy.pixel_error = min(_MOST_ERROR, max(_LEAST_ERROR, strategy.pixel_error * factor))
        self.message = f"allowed error {strategy.pixel_error:.2f} pixels"

    def freeze(self) -> None:
        """Chooses what to draw for the present view from now on, or for every view again."""
        self.walk.frozen = self.view() if self.walk.frozen is None else None
        self.message = "culling is frozen; F: go on" if self.walk.frozen else "culling follows the view"

    def screenshot(self) -> Path:
        """Saves the picture, without the text over it."""
        file = free_name(self.options.output, "vlod_screenshot_{:04d}.png")
        save(file, self.target.read())
        self.message = f"saved {file}"
        return file

    def record(self) -> None:
        """Begins to record a path, or ends it and saves it."""
        self.message = self.recorder.record()

    def replay(self) -> None:
        """Begins or ends the replay of the recorded path."""
        self.message = self.recorder.replay() or self.message

    def toggle_statistics(self) -> None:
        """Shows or hides the statistics."""
        self.show_statistics = not self.show_statistics

    def toggle_help(self) -> None:
        """Shows or hides the help."""
        self.show_help = not self.show_help

    def toggle_mouse(self) -> None:
        """Looks around without a button, or with one."""
        self.window.mouse_exclusivity = not self.window.mouse_exclusivity

    def quit(self) -> None:
        """Closes the window."""
        self.window.close()

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
        table = key_table()
        self._help = help_rows(table)
        self._held = {getattr(keys, name): move for name, move in HELD.items()}
        self._actions = {getattr(keys, name): do for row in table for name, do in row.actions.items()}

    def _make_target(self) -> Target:
        return Target(
            self.context,
            tuple(self.window.buffer_size),
            samples=self.options.screen.samples,
            reversed_depth=self.able.reversed_depth,
            see_through=self.model.see_through,
        )

    def _use_steering(self, offer: Offer) -> None:
        self.steering_name = offer.name
        self._steering: Steering = offer.load()(self, eye_height=self.options.eye_height)

    def _move(self, seconds: float) -> None:
        if self.recorder.replaying:
            self.message = self.recorder.lead(self.camera, seconds) or self.message
        else:
            self._steering.move(self.camera, min(seconds, _LONGEST_STEP))
        self.recorder.watch(self.camera, self._clock)

    def _write_over(self, s: FrameStatistics) -> None:
        """Writes statistics, help and a message over the picture in the window."""
        pending = self.walk.packs.pending
        if self.show_statistics:
            now = Situation(
                milliseconds=self._milliseconds,
                pixel_error=self.walk.strategy.pixel_error,
                frozen=self.walk.frozen is not None,
                pending=pending,
                moving=named(steering.STEERINGS, self.steering_name, "way to steer").shows,
                speed=self.camera.speed,
                model_triangles=self.model.store.manifest.model.triangles,
            )
            self._write(statistics_rows(s, now), "top left")
        if self.show_help:
            self._write(self._help, "bottom right")
        self._write(message_rows(s, pending, self.message), "bottom left")

    def _write(self, rows: Sequence[Sequence[str]], corner: str) -> None:
        self.overlay.draw(rows, self.window.fbo, self.target.size, corner)


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


def run(model: ShownModel, settings: Settings, options: WindowOptions) -> None:
    """Opens a window and plays until it is closed."""
    window = open_window(options.screen, "vLOD")
    viewer = Viewer(window, model, replace(settings, wait=False), options)
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


def _after(offers: Sequence[Offer], name: str) -> Offer:
    """The offer that follows the one of that name, round and round."""
    known = names(offers)
    return offers[(known.index(name) + 1) % len(offers)]
