"""The run folder: what a run writes, how it is read again, and whether it can be reproduced."""
