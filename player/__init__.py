"""The player: walks through a store, in a window or without one.

Imports `storage` and nothing else of this project. Read in this order:

    view          camera, projection, frustum test
    strategies/   which drawables for this view? one file each: vlod, frustum, none
    prefetch      threads that load ahead of the motion
    colours       what the colours show: the model's own, objects, levels
    cache         what stays on the GPU, within a budget of bytes
    renderer/     buffers, instances, shaders, draw calls
    walkthrough   one frame: choose, load, draw, count
    path, tour    recorded paths, and the automatic tour
    headless, compare, window, controls    the two ways to watch, and the comparison of pictures
    commands      `vlod play` and `vlod path`
"""
