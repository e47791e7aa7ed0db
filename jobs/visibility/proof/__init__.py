"""What is seen from a cell beyond doubt.

Read in this order:

    item_buffer  what images from the cell's corners show
    aimed_rays   what is proven visible by single rays; and sampling alone
"""
