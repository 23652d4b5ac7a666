"""References spread over the devices of a mesh: how a set outgrows one device, or one machine.

`match_sharded` finds what `match_batch` finds on one device: every device votes among its own
references, and after each stage the best of all go on. Ties go to the lowest id either way; what
may differ is rounding, where a device works on fewer queries at a time.

Voting and preselection, which grow with the references, are shared among the devices, and so is the
evaluation, which grows with the queries. The two quick looks at alternatives are not: their time is
the same however many references and devices there are.

With several processes (`jax.distributed`), each calls the same functions with the same arguments
and gets the same results. Scans are kept in every process, features only where they are used.
"""
