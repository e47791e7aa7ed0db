"""How geometry comes from the store to the GPU. Read in this order:

    prefetch     threads that load by a wish list, and try again what failed
    pack_cache   which packs stay, within a budget of bytes
    packs        packs on their way: decoded, made into vertices, uploaded, evicted
    stand_ins    what to draw of what has not arrived

No frame waits for more than it must, and no failed read ends a walk.
"""
