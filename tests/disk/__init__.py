"""A disk that can be cut off, that fails and that fills, under a node that does not know of it.

    `model`      what a disk holds, what of it is durable, and what a power cut may leave
    `cuts`       how a cut chooses among what was on its way
    `seams`      an apsw VFS and the calls of `os`: every operation is seen before it is done, and may be refused
    `lives`      a node's loop driven by hand, and what it promised when
    `trace`      a life with its operations and promises in order
    `recovery`   the next start on what a cut left
    `promises`   what that start must find, and what it must not do again
    `powercut`   many cuts of many lives, counted
    `failing`    a run in which one operation fails, or every one from there on
    `filling`    a disk that is full when a flight ends

Only what SQLite keeps in shared memory (`-shm`) is not modelled: it is made anew by whoever opens a log first.
"""
