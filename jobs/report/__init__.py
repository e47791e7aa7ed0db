"""What a build and a walk did, for people.

Read in this order:

    build_report  what a build did: counts, bytes, seconds and memory, stage by stage
    plots         pictures of numbers, as SVG
    page          one page of the reports and frames of a demo
"""
