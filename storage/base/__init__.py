"""What all packages use, and what knows of none of them.

Read in this order:
    errors        everything that can go wrong for a user, as one tree
    amounts       amounts of bytes as people write them
    typed_json    dataclasses as JSON and back
    temporary     names of files that are being written
    kernels       how inner loops are compiled, and when compiled code is still good
    compiling     listening to that: a first run takes minutes
    progress      telling how far long work is
"""
