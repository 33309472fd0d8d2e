"""Many fits in one process leave nothing behind: the short version of benchmarks/soak.py, and its judgement."""

import pytest

from scripts import module_of


@pytest.fixture(scope="module")
def soak():
    return module_of("benchmarks/soak.py")


def rows(memory=lambda n: 300.0, files=lambda n: 6, threads=lambda n: 4):
    return [(float(n), memory(n), files(n), threads(n)) for n in range(50, 1001, 50)]


@pytest.mark.parametrize(
    ("grows", "said"),
    [
        ({"memory": lambda n: 300 + 0.05 * n}, "memory grows by 50.0 MB in a thousand fits"),
        ({"files": lambda n: 6 + n // 400}, "open files grow"),
        ({"threads": lambda n: 4 + n // 400}, "threads grow"),
    ],
)
def test_growth_is_not_let_pass(soak, grows, said):
    with pytest.raises(AssertionError, match=said):
        soak.hold(rows(**grows))


@pytest.mark.parametrize(
    "steady",
    [
        {},
        {"memory": lambda n: 100 + min(n, 250)},
        {"memory": lambda n: 300 + (n > 600)},
        {"files": lambda n: 6 - n // 400},
    ],
)
def test_a_warm_up_a_jump_and_what_falls_are_no_growth(soak, steady):
    soak.hold(rows(**steady))


@pytest.mark.slow
def test_sixty_fits_of_all_kinds_leave_nothing_behind(soak):
    found = soak.soak(60, tell=lambda line: None)
    assert len(found) == 20
    assert len(soak.KINDS) * 3 < 60  # each kind came three times at least, to the same result
