"""What is drawn into. Read in this order:

    layers   what can be seen through: its sums, and how they are laid over the rest
    target   the picture, opaque surfaces first

Knows sizes and samples; knows nothing of views or of what is drawn.
"""
