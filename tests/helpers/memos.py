"""A memo that counts what it did not have."""

from fracid.tasks.simulation_cache import Memo


class Counting(Memo):
    """As it is, with the number of simulations that were not there."""

    computed = 0

    def keep(self, key, outputs):
        self.computed += 1
        return super().keep(key, outputs)
