"""What follows a search takes no more than twice its work, and says what it left out."""

import pytest

from fracid import Free, Problem, identification, identify
from fracid.selection import integer_alternatives
from twins import RIG, release

ORDERS = {"lambda": Free(1.0, 0.5, 1.2), "mu": Free(1.0, 0.5, 1.2)}
VALUE = {n: RIG.parameter(n).value for n in ("C1", "J_theta", "b_theta", "b_alpha")}
FREE = {n: Free(1.2 * v, 0.3 * v, 3 * v) for n, v in VALUE.items()}


def swings(count, free):
    twins = tuple(release(f"swing {k}", alpha=0.3 + 0.01 * k, step=4e-3, end=4.0, noise=1e-3, seed=k)
                  for k in range(count))  # fmt: skip
    return Problem(RIG, twins, ORDERS, free, initial_state="held")


def examined(problem, monkeypatch):
    """A fit whose alternatives get twice its search however quick that is, what they took, and what the search."""
    seen = []

    def watched(*args, watch, **options):
        found = integer_alternatives.integer_alternatives(*args, watch=watch, **options)
        seen.append((watch.work, watch.most / identification.TIMES))
        return found

    monkeypatch.setattr(identification, "LEAST", 0.0)
    monkeypatch.setattr(identification, "integer_alternatives", watched)
    fit = identify(problem)
    return fit, *seen[-1]


@pytest.mark.broad
@pytest.mark.few(1)
@pytest.mark.parametrize(("count", "free"), [(1, FREE), (1, {}), (12, {})])
def test_integer_alternatives_take_twice_the_work_of_the_search_and_a_list_that_was_cut_is_not_called_fractional(
    count, free, monkeypatch
):
    fit, took, search = examined(swings(count, free), monkeypatch)
    assert 0 < took <= 2.25 * search  # it ends after the runs that are under way
    assert fit.alternative.cut
    assert fit.claim == "undecided"
    assert "was not all tried" in fit.claim_reasons[0]
    if count > 1:
        assert fit.claim_reasons[-1] == "Models of integer order were compared on 6 of 12 recordings, 4 s of each."


@pytest.mark.broad
def test_what_is_settled_before_the_work_is_spent_stays_so(monkeypatch):
    """Friction that the model fixes at too little explains all: it's the first that is tried."""
    twin = release("swing", alpha=0.5, step=4e-3, end=4.0, noise=1e-3, orders={"lambda": 1.0, "mu": 1.0},
                   parameters={"b_alpha": 3 * VALUE["b_alpha"]})  # fmt: skip
    monkeypatch.setattr(identification, "TIMES", 50.0)
    fit, *_ = examined(Problem(RIG, (twin,), {**ORDERS, "lambda": 1.0}, initial_state="held"), monkeypatch)
    assert fit.claim == "integer"
    assert not fit.alternative.cut
