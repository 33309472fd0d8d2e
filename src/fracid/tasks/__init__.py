"""Many repetitions: on threads, on processes or on a cluster, with a journal of what is done."""

from fracid.words import Sentences

SAYS = Sentences("tasks/tasks.toml")
