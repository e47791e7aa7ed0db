"""The two ways to watch: a window, and pictures in files. Read in this order:

    compare           how two pictures of one view differ
    headless          renders a path without a window; the report
    keys              the window's table of keys
    head_up_display   what the window writes over its picture
    free_name         names of files that are not there yet
    recorder          records and replays paths
    window            the window

Both draw by `player.walkthrough`.
"""
