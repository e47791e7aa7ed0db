"""Where one looks from. Read in this order:

    view       position, orientation, lens; the projection and the view frustum
    camera     a camera that is steered
    steering/  ways to steer it: one file each
    path       recorded paths: read, written, interpolated

Knows neither windows nor stores.
"""
