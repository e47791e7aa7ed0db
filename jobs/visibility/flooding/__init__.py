"""Flooding: which triangles together hide what is behind them, and what they hide.

Read in this order:

    flood          from a core to an occluder set
    seals          the same, going on at narrow gaps that count as closed
    occludees      which boxes, clusters and triangles are hidden
    front_to_back  clusters in the order in which they may occlude
    occluders      occluder sets drawn into layers, with the theorem that it all rests on
"""
