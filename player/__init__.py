"""The player: walks through a store, in a window or without one.

Imports `storage` and nothing else of this project. Read in this order:

    camera/       where one looks from, ways to steer, recorded paths
    shown_model   what the rest knows of a store: its tables, with boxes laid out for fast tests
    strategies/   which drawables for this view? one file each
    loading/      how geometry comes to the GPU: loaded ahead, kept within a budget, stood in for meanwhile
    colouring/    what the colours show, one file each
    renderer/     buffers, instances, shaders, draw calls
    walkthrough   one frame: choose, load, draw, count
    tour/         automatic tours, one file a kind
    shells/       the two ways to watch, and the comparison of pictures
    offers        what a user can choose by name: the lists of strategies, colourings, ways to steer, tours
    options       the options of the commands, in groups
    commands      `vlod play` and `vlod path`
    errors        what can go wrong here and nowhere else
"""
