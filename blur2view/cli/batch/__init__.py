"""What the commands over photographs share: a run of jobs, one for each photograph, and what it prints.

`run` checks what is written and does the photographs; `schedule` gives their `job`s to processes or to a Dask
cluster (`executors`), each with what `reading` has read ahead; `photograph` estimates one, and `summary`
prints what has come of all.
"""
