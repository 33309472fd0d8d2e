"""A memo that counts what it did not have."""

from fracid.tasks.simulation_cache import Memo


class Counting(Memo):
    """As it is, with the number of simulations that were not there."""

    computed = 0

    def get(self, key, compute):
        def counted():
            self.computed += 1
            return compute()

        return super().get(key, counted)
