"""From-region visibility: what can be seen from anywhere in a view cell.

Read in this order, each room on those before it:

    surfaces/  the triangles that the cells of a task share, as one of them sees them, and rays against them
    images/    images on the faces of a cube around a cell, and what their pixels hide
    flooding/  what is hidden: occluder sets, flooded from small cores, and what lies behind them
    proof/     what is seen beyond doubt: item buffers and aimed rays
    shafts/    what images leave undecided: shafts between parts of the cell and parts of what is looked at
    shrunk/    to compare with, the vLOD paper's own method
    settings   the ways to find what is hidden, and how hard the engine tries
    engine     one cell, from a cut to its visible ids and how much of that is proven

`engine`, `settings` and `surfaces.soup` are for others; all else are kernels: pure functions from arrays to arrays.
"""
