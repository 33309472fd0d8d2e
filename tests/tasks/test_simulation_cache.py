"""What was simulated once is not simulated again, and comes back to the bit."""

from dataclasses import replace

import numpy as np
import pytest

import fracid
from fracid.errors import Failure, FailureReason
from fracid.problem import Experiment, Free, Problem
from fracid.tasks import simulation_cache
from memos import Counting

pytestmark = pytest.mark.usefixtures("without_rivals")

KEY, OTHER = b"k" * 16, b"o" * 16

ARRAYS = {
    "by rows": np.random.default_rng(1).standard_normal((5, 2)),
    "by columns": np.asfortranarray(np.random.default_rng(2).standard_normal((5, 2))),
    "one row": np.array([[np.pi, -0.0]]),
    "awkward": np.array([[5e-324, -1.7e308], [np.inf, 1.0]]),
}

DIVERGED, ENDED = (Failure(FailureReason.RUN, detail) for detail in ("diverged at t = 3 µs", "overflow"))


def get(memo, key, compute):
    found = memo.find(key)
    return memo.keep(key, compute()) if found is None else found


def refused():
    raise AssertionError("computed again")


@pytest.mark.parametrize("kept", [*ARRAYS.values(), DIVERGED], ids=[*ARRAYS, "reason"])
def test_what_is_kept_comes_back_to_the_bit_and_in_its_order_in_memory(tmp_path, kept):
    with Counting(tmp_path / "memo") as memo:
        assert get(memo, KEY, lambda: kept) is kept
    with Counting(tmp_path / "memo") as memo:
        found = get(memo, KEY, refused)
        assert memo.computed == 0
    if isinstance(kept, Failure):
        assert found == kept
    else:
        assert found.tobytes("A") == kept.tobytes("A")
        assert found.flags.c_contiguous == kept.flags.c_contiguous


@pytest.mark.few(1)
@pytest.mark.parametrize("first", range(8))
def test_a_record_torn_at_any_byte_is_computed_again_and_no_other(tmp_path, first):
    path = tmp_path / "memo"
    with Counting(path) as memo:
        get(memo, KEY, lambda: ARRAYS["by rows"])
        before = path.stat().st_size
        get(memo, OTHER, lambda: ARRAYS["one row"])
    whole = path.read_bytes()
    for end in range(before + first, len(whole), 8):
        path.write_bytes(whole[:end])
        with Counting(path) as memo:
            assert np.array_equal(get(memo, KEY, refused), ARRAYS["by rows"])
            get(memo, OTHER, lambda: ARRAYS["one row"])
            assert memo.computed == 1
        assert path.read_bytes() == whole


@pytest.mark.parametrize("content", [b"\xf2\xff no text", b"NO_SUCH_REASON diverged", b""])
def test_a_reason_that_fracid_does_not_write_is_computed_again(tmp_path, content):
    with Counting(tmp_path / "memo") as memo:
        checked = simulation_cache._sum(KEY, content)
        memo._file.write(simulation_cache.RECORD.pack(KEY, len(content), checked) + content)
    with Counting(tmp_path / "memo") as memo:
        assert get(memo, KEY, lambda: DIVERGED) == DIVERGED
        assert memo.computed == 1


@pytest.mark.broad
def test_a_bit_that_turned_on_the_disk_is_computed_again(tmp_path):
    path = tmp_path / "memo"
    with Counting(path) as memo:
        get(memo, KEY, lambda: ARRAYS["by rows"])
    whole = path.read_bytes()
    for at in range(16, len(whole)):  # behind the stamp
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 4]) + whole[at + 1 :])
        with Counting(path) as memo:
            assert np.array_equal(get(memo, KEY, lambda: ARRAYS["by rows"]), ARRAYS["by rows"])
            assert memo.computed == 1


def test_another_program_or_a_restarted_machine_begins_empty(tmp_path, monkeypatch):
    with Counting(tmp_path / "memo") as memo:
        get(memo, KEY, lambda: DIVERGED)
    monkeypatch.setattr("fracid.tasks.simulation_cache._stamp", lambda: b"another machine.")
    with Counting(tmp_path / "memo") as memo:
        assert get(memo, KEY, lambda: ENDED) is ENDED


def test_where_there_is_no_room_the_run_goes_on_and_the_file_goes(tmp_path):
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with Counting(tmp_path / "memo") as memo:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
        try:
            for i in range(20):
                assert get(memo, bytes([i]) * 16, lambda: ARRAYS["by rows"]) is ARRAYS["by rows"]
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not (tmp_path / "memo").exists()


# --- of a problem ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def problem():
    rig = fracid.rotary_pendulum("srv02-rotpen")
    run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=5e-3, end=2.0)
    swing = Experiment("twin", 5e-3, run.states[:, [0, 2]], np.zeros((1, 1)))
    return Problem(rig, (swing,), {"lambda": Free(1.0, 0.5, 1.2), "mu": Free(0.9, 0.5, 1.2)}, {"C4": 0.2})


def longer(p):
    (e,) = p.experiments
    return replace(p, experiments=(replace(e, measured=np.vstack([e.measured, e.measured[-5:]])),))


def driven(p):
    (e,) = p.experiments
    return replace(p, experiments=(replace(e, inputs=np.full((len(e.measured), 1), 0.5)),))


VARIANTS = {
    "another constant": lambda p: replace(p, parameters={"C4": 0.21}),
    "another order": lambda p: replace(p, orders={**p.orders, "lambda": Free(1.01, 0.5, 1.2)}),
    "another method": lambda p: replace(p, method="gl"),
    "a finer step": lambda p: replace(p, substeps=2),
    "another memory": lambda p: replace(p, memory=fracid.solver.memory.short(200)),
    "a shorter horizon": lambda p: p.until(1.0),
    "more samples": longer,
    "an input": driven,
    "other outputs": lambda p: replace(
        p, outputs=("alpha",), experiments=(replace(p.experiments[0], measured=p.experiments[0].measured[:, 1:]),)
    ),
    "upright": lambda p: replace(p, model=fracid.rotary_pendulum("srv02-rotpen", zero="upright")),
    "another start": lambda p: replace(p, experiments=(replace(p.experiments[0], initial={"alpha": 0.31}),)),
}


@pytest.mark.parametrize("variant", VARIANTS.values(), ids=VARIANTS)
def test_whatever_changes_a_simulation_is_another_one_to_the_memo(tmp_path, problem, variant):
    other = variant(problem)
    with Counting(tmp_path / "memo") as memo:
        for p in (problem, other):
            kept = replace(p, memo=memo)
            assert np.array_equal(kept.evaluate(p.start).residuals, p.evaluate(p.start).residuals)
        assert memo.computed == 2
        assert replace(other, memo=memo).cost(other.start) == other.cost(other.start)
        assert memo.computed == 2


def test_what_changes_no_simulation_is_read_from_the_memo(tmp_path, problem):
    cheaper = replace(problem, cost_function=fracid.problem.costs.COSTS["itae"], weights="noise")
    with Counting(tmp_path / "memo") as memo:
        for p in (problem, cheaper):
            assert replace(p, memo=memo).cost(p.start) == p.cost(p.start)
        assert memo.computed == 1


@pytest.mark.broad
def test_a_whole_identification_repeats_no_simulation_and_ends_the_same(tmp_path, problem):
    bare = fracid.identify(problem)
    with Counting(tmp_path / "memo") as memo:
        first = fracid.identify(replace(problem, memo=memo), jobs=2)
        assert memo.computed > 20
    with Counting(tmp_path / "memo") as memo:
        again = fracid.identify(replace(problem, memo=memo))
        assert memo.computed == 0
    assert bare.to_json() == first.to_json() == again.to_json()


def test_a_file_that_is_full_keeps_what_it_has_and_what_follows_stays_in_memory(tmp_path):
    path, rows = tmp_path / "memo", np.ones((100, 2))
    with Counting(path, most=2000) as memo:
        get(memo, KEY, lambda: rows)
        size = path.stat().st_size
        for key in (OTHER, b"p" * 16):
            get(memo, key, lambda: ARRAYS["one row"] if key == OTHER else rows[:50])
        assert get(memo, KEY, refused).shape == (100, 2)
        assert size < path.stat().st_size <= 2000
        get(memo, b"q" * 16, lambda: rows)
        get(memo, b"r" * 16, lambda: rows[:9])
        assert get(memo, b"r" * 16, refused).shape == (9, 2)
        assert path.stat().st_size <= 2000


def test_a_file_takes_no_more_than_half_of_what_the_disk_has_left(tmp_path, monkeypatch):
    usage = type("Usage", (), {"free": 3000})()
    monkeypatch.setattr(simulation_cache.shutil, "disk_usage", lambda _: usage)
    path = tmp_path / "memo"
    with Counting(path) as memo:
        for key in (KEY, OTHER):
            get(memo, key, lambda: np.ones((60, 2)))
    assert 900 < path.stat().st_size <= 1500
