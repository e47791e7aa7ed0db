"""The command line.

Read in this order:
    command    `vlod`: finds subcommands where they live, and ends errors in one line
    info       `vlod info`: what a store holds, as
    facts      numbers and names that JSON can say, and
    text       tables and lines for people
    versions   `vlod versions`: the versions of a store
"""
