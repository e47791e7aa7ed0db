"""Draws drawables as seen from a view. Read in this order:

    context      what OpenGL can do; contexts without a window
    free_list    ranges of a buffer that are free
    arena        where meshes lie on the GPU
    instances    where they stand
    facet_table  which parts of them turn their backs
    draw_list    what to draw: commands from drawables
    shaders      how surfaces, sky and text look
    surfaces     how a draw list is drawn
    targets/     into what; how what can be seen through is blended
    text         over it
    renderer     all of it together

Knows the GPU; knows nothing of cells, strategies or files.
"""
