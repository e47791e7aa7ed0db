"""Shafts: what neither images hide nor rays prove to be seen.

Read in this order:

    shafts        what may lie between a part of the cell and a part of a drawable
    closing_sets  what closes a shaft, with the proof
    undecided     shafts that are split until what images leave open is hidden, or seen
"""
