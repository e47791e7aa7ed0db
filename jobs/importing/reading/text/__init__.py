"""What readers of text share.

Read in this order:

    words    names, references to other files, and the mark that some writers put before all of it
    numbers  numbers, many at once
"""
