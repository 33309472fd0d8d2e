"""Settings for the whole suite, and what is made once a session for all tests.

Property tests repeat themselves, unless asked to explore (make fuzz).
"""

import ctypes
import gc
import os
import shutil
import signal
import sys
from collections import defaultdict
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis.internal.conjecture import providers

import folders
import program

settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=30)
settings.register_profile("explore", deadline=None, print_blob=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeatable"))
# Constants of what has been imported by then would not be the same from session to session, and take seconds to read.
providers._get_local_constants = lambda: providers._local_constants
# By default the collector looks through a million objects that stay, again and again: 9 s of the suite.
gc.set_threshold(200_000, 10, 100)

UNHURRIED = ("broad", "slow")
"""Markers of what `make test` leaves out."""
PROGRAMS = {"browser", "in_octave"}
"""Fixtures that start another's program: who takes one is broad."""
LONG_DOCTESTS = (
    "identification.identify", "noise.noise_levels", "sensor_faults.misread", "comparison.compare",
    "monte_carlo.noise_study", "estimation.fit_figures", "amplitude.amplitude_test", "reduction.multi_term",
    "linear.linear_response", "alternatives.orders_alone", "alternatives.with_states", "c.c_model", "Twin.of_library",
    "inference.posterior", "long_records.coarse_problem", "long_records.thinned", "feedback.study.control",
    "finite_memory.finite_memories", "long_records.to_compare", "outputs.output_along", "block_bootstrap.bootstrap",
    "workflows.fit.run", "long_records.as_fitted", "fractional_element.fractional_element",
)  # fmt: skip
"""Those above 0.3 s, which cannot be marked where they stand: broad too."""
BUDGET = 5.0
"""What a test of `make test` may take [s of processor time]: who takes more is listed."""
BEGAN = pytest.StashKey[float]()


def pytest_configure():
    """Ctrl-C means what it means, here and in each process that is started, also if the shell had it ignored."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_finish():
    """What is there before the first test stays: the collector need not look at it any more."""
    gc.freeze()


def _minutes(item):
    marker = item.get_closest_marker("slow")
    return marker.kwargs.get("minutes", 0) if marker else 0


@pytest.hookimpl(tryfirst=True)  # before what is not asked for is left out
def pytest_collection_modifyitems(items):
    """Mark what is broad: of the variants of a test all but those that ``few`` keeps, spread evenly, and the rest."""
    variants = defaultdict(list)
    for item in items:
        if PROGRAMS & set(getattr(item, "fixturenames", ())) or item.name.endswith(LONG_DOCTESTS):
            item.add_marker("broad")
        if item.get_closest_marker("few"):
            variants[item.parent.nodeid, item.originalname].append(item)
    for of_one in variants.values():
        kept = of_one[0].get_closest_marker("few").args[0]
        at = {round(k * (len(of_one) - 1) / max(kept - 1, 1)) for k in range(kept)}
        for item in (item for k, item in enumerate(of_one) if k not in at):
            item.add_marker("broad")
    items.sort(key=_minutes, reverse=True)  # the longest first, so that none is left to run alone at the end


def processor_time():
    """Of this process and of those that it has waited for [s]: a busy machine does not lengthen it."""
    return sum(os.times()[:4])


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    """Note when a test begins, the making of what it takes included."""
    item.stash[BEGAN] = processor_time()
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """Say with a test's end what it took, if that is more than `make test` has for it."""
    report = yield
    took = processor_time() - item.stash[BEGAN]
    if report.when == "teardown" and took > BUDGET and not any(map(item.get_closest_marker, UNHURRIED)):
        report.user_properties.append(("too long", took))
    return report


def pytest_terminal_summary(terminalreporter):
    """List what is too slow for `make test`."""
    reports = terminalreporter.getreports("")
    slow = [(took, r.nodeid) for r in reports for name, took in r.user_properties if name == "too long"]
    if slow:
        terminalreporter.section(f"above {BUDGET:g} s: make them shorter, or mark them broad (make test-all)")
        for took, name in sorted(slow, reverse=True):
            terminalreporter.line(f"{took:6.1f} s  {name}")


@pytest.fixture(scope="session")
def plain(tmp_path_factory):
    """The folder of a project with its run; nobody changes it."""
    return folders.made_once(folders.plain, tmp_path_factory)


@pytest.fixture(scope="session")
def two_recordings(tmp_path_factory):
    """The same of a recording that is fitted and one, driven, that is not."""
    return folders.made_once(folders.two_recordings, tmp_path_factory)


@pytest.fixture
def without_rivals():
    """Fits without the models of integer order beside them, in tests that ask for other things."""
    with program.no_rivals():
        yield


@pytest.fixture
def heeding_modes():
    """Root obeys the modes of files as all do: without CAP_DAC_OVERRIDE and CAP_DAC_READ_SEARCH, bits 1 and 2."""
    if sys.platform != "linux" or os.geteuid() != 0:
        yield
        return
    libc, header, sets = ctypes.CDLL(None), (ctypes.c_uint32 * 2)(0x20080522, 0), (ctypes.c_uint32 * 6)()
    assert libc.capget(header, sets) == 0
    all_of_them = sets[0]
    sets[0] &= ~0b110
    assert libc.capset(header, sets) == 0
    yield
    sets[0] = all_of_them
    assert libc.capset(header, sets) == 0


@pytest.fixture
def sent(plain, tmp_path, monkeypatch):
    """The run of `plain` in a folder that one stands in, free to be spoilt."""
    shutil.copytree(plain, tmp_path / "sent")
    monkeypatch.chdir(tmp_path / "sent")
    return Path("run")
