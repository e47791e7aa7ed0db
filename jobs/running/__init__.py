"""Running tasks: what a task is, where its result lies, and who does it. Knows nothing of what tasks do.

Read in this order:

    errors            what can go wrong in a job beside bad input
    tasks             what a task is, its key, and how its result is found or made
    workplace         where results are kept, and how they are published
    lock              one build at a time in a directory
    memory            how much memory tasks and builds take
    arrays            arrays as files
    executors         the protocol and the loop of executors; tasks in this process, or elsewhere once they take long
    ray_executor      tasks on a cluster: the only module that knows Ray
    choose_executor   which of them a build runs on
    compiling_signs   that a worker compiles, told to the build
    run               stages one after the other, how many tasks they will have, and what they took
"""
