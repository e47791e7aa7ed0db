"""Run under a virtual display by test_window: opens the window, steers it, and prints what happened as JSON.

python window_script.py STORE PATH OUTPUT
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from player.camera.path import read_path
from player.shells.headless import Screen
from player.shells.window import Viewer, WindowOptions, open_window
from player.shown_model import shown_model
from player.walkthrough import Settings
from storage.store import open_store


def main() -> None:
    """Starts, moves, looks, switches everything once, takes a picture, records, replays, walks, and quits."""
    store, tour, output = sys.argv[1:]
    options = WindowOptions(Screen(320, 180, 60), read_path(tour), False, Path(output), 1.6)
    window = open_window(options.screen, "test")
    viewer = Viewer(window, shown_model(open_store(store)), Settings(wait=False), options)
    keys = window.keys
    found: dict[str, object] = {}

    def press(key: object, *, down: bool = True) -> None:
        action = keys.ACTION_PRESS if down else keys.ACTION_RELEASE
        window.key_event_func(key, action, SimpleNamespace(shift=False, ctrl=False, alt=False))

    def frames(count: int) -> None:
        for _ in range(count):
            viewer.step(0.02)
            window.swap_buffers()

    deadline = time.monotonic() + 60
    frames(1)
    while time.monotonic() < deadline and (viewer.walk.packs.pending or not viewer.statistics.computed):
        frames(1)
        time.sleep(0.01)
    frames(1)
    found["triangles"] = viewer.statistics.triangles
    shown = np.frombuffer(window.fbo.read(components=3, alignment=1), np.uint8)
    found["shown"] = int(shown.std())
    found["screenshot"] = str(viewer.screenshot())

    start = viewer.camera.position.copy()
    press(keys.R)
    press(keys.W)
    frames(8)
    press(keys.W, down=False)
    found["moved"] = float(np.linalg.norm(viewer.camera.position - start))
    yaw = viewer.camera.yaw
    window.mouse_drag_event_func(0, 0, 40, 0)
    found["turned"] = yaw - viewer.camera.yaw
    speed = viewer.camera.speed
    window.mouse_scroll_event_func(0, 1)
    found["faster"] = viewer.camera.speed / speed
    frames(1)
    press(keys.R)
    found["recorded"] = len(viewer.recorder.recorded)
    end = viewer.camera.position.copy()
    press(keys.T)
    frames(2)
    found["replayed from"] = float(np.linalg.norm(viewer.camera.position - start))
    frames(20)
    found["replayed to"] = float(np.linalg.norm(viewer.camera.position - end))

    press(keys.G)
    frames(60)
    found["standing"] = float(viewer.camera.position[2])
    viewer.camera.yaw, viewer.camera.pitch = 3.14159, 0.0
    press(keys.A, down=False)
    press(keys.W)
    viewer.camera.speed = 10.0
    frames(120)
    press(keys.W, down=False)
    found["at the wall"] = float(viewer.camera.position[0])
    strategies = []
    for key in (keys.NUMBER_2, keys.NUMBER_3, keys.NUMBER_1):
        press(key)
        frames(1)
        strategies.append(viewer.statistics.strategy)
    found["strategies"] = strategies
    error = viewer.walk.strategy.pixel_error
    press(keys.EQUAL)
    found["coarser"] = viewer.walk.strategy.pixel_error / error
    colours = []
    for _ in range(3):
        press(keys.C)
        frames(1)
        colours.append(viewer.walk.colours)
    found["colours"] = colours
    for key in (keys.F, keys.H, keys.O, keys.O, keys.F, keys.H):
        press(key)
        frames(1)
    window.size = (400, 240)
    frames(3)
    press(keys.ESCAPE)
    found["closing"] = bool(window.is_closing)
    viewer.close()
    window.destroy()
    print(json.dumps(found))


if __name__ == "__main__":
    main()
