"""Many repetitions: on threads, on processes or on a cluster, with a journal of what is done."""
