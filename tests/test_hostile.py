"""What a careless user does, and a malicious one: nothing is answered wrongly in silence, no work is lost."""

import numpy as np
import pytest

from fracid.recording import Recording

# --- recordings that are mangled as real ones are ------------------------------------------------------

T = np.arange(0, 8, 0.004)
ALPHA = 2 * np.pi / 4096 * np.rint(4096 / (2 * np.pi) * 1.05 * np.cos(8 * T) * np.exp(-0.3 * T))


def changed(samples, where, value):
    """The samples with some of them replaced."""
    x = samples.copy()
    x[where] = value
    return x


MANGLED = {
    "counts as they are": ("counts-as-radians", T, np.rint(4096 / (2 * np.pi) * ALPHA)),
    "milliseconds": ("wrong-clock", 1e3 * T, ALPHA),
    "microseconds": ("wrong-clock", 1e6 * T, ALPHA),
    "the number of the sample as time": ("wrong-clock", np.arange(T.size, dtype=float), ALPHA),
    "minutes": ("wrong-clock", T / 60, ALPHA),
    "one wild sample": ("jump", T, changed(ALPHA, 700, 50.0)),
    "a wild sample of 30 degrees": ("jump", T, changed(ALPHA, 700, ALPHA[700] + 0.5)),
    "zeros where nothing was read": ("jump", T, changed(ALPHA, slice(690, 720), 0.0)),
    "-9999 where nothing was read": ("jump", T, changed(ALPHA, slice(690, 720), -9999.0)),
    "a count that was wrapped": ("jump", T, changed(ALPHA, slice(700, None), ALPHA[700:] + 2 * np.pi)),
    "a wrapped angle": ("jump", T, np.mod(ALPHA + 6.0, 2 * np.pi)),
    "the recording twice in one file": ("jump", np.arange(2 * T.size) * 0.004, np.tile(ALPHA, 2)),
}


@pytest.mark.parametrize("how", MANGLED)
def test_a_mangled_recording_is_not_called_good(how):
    code, time, alpha = MANGLED[how]
    report = Recording.of("swing", time, {"alpha": alpha}).report
    assert {f.code for f in report.findings} == {code}
    assert report.level == "usable"
    (found,) = report.findings
    assert (found.number > found.limit) != ("minutes" == how)


def test_the_jump_of_a_whole_turn_says_unwrap_and_another_does_not():
    turn, glitch = (Recording.of("s", *MANGLED[how][1:2], {"alpha": MANGLED[how][2]}).report.findings[0].sentence
                    for how in ("a count that was wrapped", "one wild sample"))  # fmt: skip
    assert "unwrap = true" in turn and "unwrap" not in glitch
    assert "once after 2.796 s" in turn


@pytest.mark.parametrize(
    "moves",
    [
        np.where(T < 2, 1.0, np.cos(9 * (T - 2))),  # let go
        np.where(T < 2, 0.0, np.minimum(30 * (T - 2), 1.0)),  # hits a stop
        np.cumsum(np.random.default_rng(3).choice([0, 0.0314], T.size, p=[0.8, 0.2])),  # a stepper motor's steps
        np.random.default_rng(4).standard_normal(T.size),  # all noise
        np.round(np.cos(0.9 * T), 2),  # a coarse encoder
    ],
)
def test_what_moves_as_things_do_does_not_jump(moves):
    found = Recording.of("arm", T, {"theta": moves, "alpha": ALPHA}).report.findings
    assert "jump" not in {f.code for f in found}
