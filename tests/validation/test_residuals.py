"""Residuals of known properties are called by their names, in words, and their p-values are what they promise."""

import io
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from matplotlib.patches import StepPatch
from matplotlib.text import Text
from scipy import stats
from scipy.signal import lfilter

import fracid
from fracid.errors import InputError
from fracid.plots import residual_diagnostics, save
from fracid.signals.correlation import autocorrelation, correlation_time, power_spectrum
from fracid.signals.left_over import left_over
from fracid.validation.residual_sentences import NORMAL
from fracid.validation.residual_tests import anderson_darling, breusch_pagan
from fracid.validation.residuals import residual_analysis
from twins import fit_of

N, STEP = 20_000, 1e-3
TIME = STEP * np.arange(N)
ENCODER = 2 * np.pi / 4096
SWING = 1.5
"""Of the fitted motion [Hz]."""
FITTED = 0.3 * np.cos(2 * np.pi * SWING * TIME)
NOWHERE = {"alpha": None}
"""No encoder."""


def rng(seed=1):
    return np.random.default_rng(seed)


def twin(residual, fitted=None, **changes):
    """A recording with that residual [rad]."""
    n = residual.size
    fitted = FITTED[:n] if fitted is None else fitted
    return replace(fit_of({"alpha": fitted}, {"alpha": residual}, STEP * np.arange(n)), **changes)


def analysed(residual, fitted=None, resolution=NOWHERE):
    return residual_analysis(twin(residual, fitted), "alpha", resolution)


def white(seed=1, n=N):
    return 1e-3 * rng(seed).standard_normal(n)


def ar1(correlation, seed=1, n=N):
    """Normal noise whose neighbours correlate; of variance 1e-6."""
    drive = white(seed, n + 4000) * np.sqrt(1 - correlation**2)
    return lfilter([1], [1, -correlation], drive)[4000:]


def wave(frequency, share):
    """White noise, and a sine with a share of the power."""
    return np.sqrt(1 - share) * white() + 1e-3 * np.sqrt(2 * share) * np.sin(2 * np.pi * frequency * TIME + 1)


# --- whiteness -------------------------------------------------------------------------------------


def test_white_normal_noise_passes_every_question():
    found = analysed(white())
    assert found.whiteness.white
    assert abs(found.whiteness.lag_one) < 3 / np.sqrt(N)
    assert found.whiteness.effective_samples > 0.9 * N
    assert found.spectrum.line is None
    words = found.sentences
    assert words["whiteness"].startswith("White: no autocorrelation in 20,000 samples")
    assert words["spectrum"].startswith("No frequency stands out, and there is no drift")
    assert words["normality"].startswith("Normal enough: PPCC 1.000")
    assert words["variance"].startswith("The residual has the same rms early and late, near and far, slow and fast")


@pytest.mark.parametrize(("correlation", "words"), [
    (0.5, "beside the swing's 0.67 s that is so short that it is rather the sensor, its filter or a vibration"),
    (0.9, "rather the sensor"),
    (0.98, "the model lacks something. Intervals that take the samples for independent"),
])  # fmt: skip
def test_fading_noise_has_its_correlation_time_and_no_frequency(correlation, words):
    times = [analysed(ar1(correlation, seed)).whiteness.correlation_time for seed in range(5)]
    assert np.mean(times) == pytest.approx(STEP * (1 + correlation) / (1 - correlation), rel=0.15)
    found = analysed(ar1(correlation))
    assert not found.whiteness.white
    assert found.whiteness.lag_one == pytest.approx(correlation, abs=0.02)
    assert found.whiteness.effective_samples == pytest.approx(N * STEP / found.whiteness.correlation_time)
    assert found.spectrum.line is None
    worth = f"20,000 samples are worth {found.whiteness.effective_samples:,.0f} independent ones"
    assert worth in found.sentences["whiteness"]
    assert words in found.sentences["whiteness"]


def test_thinning_takes_every_sample_two_correlation_times_apart():
    found = analysed(ar1(0.9)).whiteness
    assert found.thinning == pytest.approx(2 * found.correlation_time / STEP, abs=0.5)
    assert found.thinned_samples == len(range(0, N, found.thinning))
    assert analysed(white()).whiteness.thinning == 2


def test_a_correlation_that_only_shows_because_there_are_many_samples_needs_nothing():
    found = analysed(ar1(0.06))
    assert found.whiteness.p_value < 0.01
    assert found.whiteness.white
    assert "Next to white: neighbours correlate by +0.0" in found.sentences["whiteness"]
    assert "nothing need be done" in found.sentences["whiteness"]


def test_neighbours_that_alternate_are_no_fault_of_the_model():
    found = analysed(ar1(-0.6))
    assert found.whiteness.lag_one == pytest.approx(-0.6, abs=0.03)
    assert "neighbours alternate" in found.sentences["whiteness"]
    assert "lacks" not in found.sentences["whiteness"]


def test_the_test_of_whiteness_is_box_and_pierces_of_a_constant_size():
    from statsmodels.stats.diagnostic import acorr_ljungbox

    e = ar1(0.1, n=20_000)
    expected, found = acorr_ljungbox(e, lags=[10], boxpierce=True).iloc[0], analysed(e).whiteness
    assert found.lags == 10
    assert found.statistic == pytest.approx(expected["bp_stat"], rel=0.05)


EPIDEMIC = np.sqrt(5 + 1e5 * np.exp(-((np.arange(121) - 50) ** 2) / 2 / 15**2))
"""The spread of cases that are counted."""


@pytest.mark.parametrize("spread", [
    np.ones(1000), EPIDEMIC, np.where(np.arange(1000) < 100, 5.0, 1.0), 0.02 + np.exp(-np.arange(500) / 80),
    0.02 + np.abs(np.sin(np.arange(600) / 30)),
])  # fmt: skip
def test_noise_is_white_however_its_size_changes_and_a_correlation_is_found_beside_it(spread):
    ramp, wrong, missed = np.arange(float(spread.size)), 0, 0
    for noise in rng().normal(size=(200, spread.size)):
        wrong += not left_over(noise * spread, ramp).white
        missed += left_over(lfilter([1.0], [1.0, -0.6], noise) * spread, ramp).white
    assert wrong <= 20  # of 200: 5 %, and three deviations of that
    assert missed <= 40


@pytest.mark.parametrize("period", [20, 100, 1000])
def test_a_swing_that_stays_counts_as_few_samples_although_its_correlations_add_up_to_nothing(period):
    rho = autocorrelation(np.sin(2 * np.pi * np.arange(N) / period))
    assert correlation_time(rho) > N / 20
    assert abs(2 * np.sum(rho) - 1) < N / 100


def test_correlations_add_up_as_those_of_an_ar1_process_do():
    k = np.arange(5000)
    for correlation in (0.0, 0.3, 0.9, 0.99):
        expected = (1 + correlation) / (1 - correlation)
        assert correlation_time(correlation**k) == pytest.approx(expected, rel=0.02)
    squares = correlation_time((-0.9) ** k)  # T1 is below 1 here
    assert squares == pytest.approx((1 + 0.81) / (1 - 0.81), rel=0.02)


# --- spectrum --------------------------------------------------------------------------------------


@pytest.mark.few(8)
@pytest.mark.parametrize(("multiple", "harmonic", "words"), [
    (1, 1, "the swing's own frequency: the simulated swing is too large, too small or out of phase"),
    (1.04, 1, "Free Coulomb friction, drag"),
    (2, 2, "2 times the swing's: something differs between left and right"),
    (3, 3, "3 times the swing's: it bends within each swing"),
    (4, 4, "4 times the swing's: something differs between left and right"),
    (5, 5, "5 times the swing's: it bends within each swing"),
    (1.5, None, "no multiple of the swing's 1.5 Hz: another part that moves"),
    (33.3, None, "another part that moves"),
])  # fmt: skip
@pytest.mark.parametrize("share", [0.15, 0.6])
def test_a_sine_left_over_is_found_with_its_share_and_what_it_says(multiple, harmonic, words, share):
    found = analysed(wave(multiple * SWING, share))
    line = found.spectrum.line
    assert line.frequency == pytest.approx(multiple * SWING, abs=0.5 / TIME[-1])
    assert line.share == pytest.approx(share, abs=0.03)
    assert line.harmonic == harmonic
    assert words in found.sentences["spectrum"]
    assert f"{100 * line.share:.0f} % of its power" in found.sentences["spectrum"]


def test_of_a_held_out_recording_the_values_may_be_off_and_no_interval_allows_for_it():
    residual = wave(SWING, 0.6) * np.linspace(3.0, 1.0, N)
    fit, held_out = (residual_analysis(twin(residual, use=use), "alpha", NOWHERE) for use in ("fit", "validate"))
    text, of_fit = (" ".join(found.sentences.values()) for found in (held_out, fit))
    assert "allow for it" in of_fit
    assert "Free Coulomb friction" in of_fit
    assert "the model lacks something, or its values, fitted to other recordings, do not hold for this one" in text
    assert "by the model or by values fitted to other recordings" in text
    assert "allow for it" not in text
    assert "Free Coulomb friction" not in text


def test_a_damped_swing_is_a_band_and_its_own_frequency_is_found_in_it():
    fitted = 0.3 * np.exp(-3 * TIME) * np.cos(2 * np.pi * SWING * TIME)
    late = 0.03 * np.exp(-3 * TIME) * np.cos(2 * np.pi * 1.25 * SWING * TIME)
    assert analysed(wave(1.25 * SWING, 0.6), fitted).spectrum.line.harmonic == 1
    assert analysed(wave(1.25 * SWING, 0.6)).spectrum.line.harmonic is None
    assert analysed(late + 0.01 * white(), fitted).spectrum.swing == pytest.approx(SWING, abs=0.1)


@pytest.mark.broad
def test_fading_noise_is_not_taken_for_a_swing():
    lines = [analysed(ar1(0.99, seed)).spectrum.line for seed in range(40)]
    assert sum(line is not None for line in lines) <= 2


@pytest.mark.parametrize("drift", [TIME - 10, np.exp(-TIME / 8), np.sin(2 * np.pi * 0.1 * TIME)])
def test_a_drift_is_called_one(drift):
    found = analysed(white() + 3e-3 * (drift - drift.mean()) / drift.std())
    assert found.spectrum.slow_share > 0.8
    assert "is slower than 0.5 Hz: a drift. The rest angle creeps" in found.sentences["spectrum"]
    assert found.spectrum.line is None


def test_a_motion_that_does_not_swing_has_no_multiples():
    for fitted in (np.full(N, 0.2), 0.3 * np.exp(-TIME)):
        found = analysed(wave(5.0, 0.5), fitted)
        assert found.spectrum.swing is None
        assert "5 Hz, where the simulated motion has no peak: another part that moves" in found.sentences["spectrum"]


@pytest.mark.parametrize("slow", [0.3 * np.exp(-TIME), 0.3 * np.cos(2 * np.pi * 0.7 * TIME)])
def test_a_resonance_that_the_model_has_too_is_not_put_down_to_another_part(slow):
    rings = slow + 1e-3 * np.exp(-TIME) * np.cos(2 * np.pi * 18.2 * TIME)
    said = analysed(wave(18.2, 0.5), rings).sentences["spectrum"]
    assert "18.2 Hz, where the simulated motion has a peak too: the simulated swing is too large, too small" in said
    assert (
        "18.2 Hz, where the simulated motion has a peak too"
        not in analysed(wave(33.0, 0.5), rings).sentences["spectrum"]
    )
    assert "another part that moves" in analysed(wave(33.0, 0.5), rings).sentences["spectrum"]


def test_a_broad_band_around_the_swing_is_said_and_white_noise_is_not_one():
    late = 0.2 * np.exp(-TIME / 4) * np.sin(2 * np.pi * SWING * TIME)
    bands = [np.convolve(white(seed), np.cos(2 * np.pi * SWING * np.arange(0, 1, STEP)), "same") for seed in range(3)]
    for band in bands:
        found = analysed(band / band.std(), late)
        if found.spectrum.line is None:
            assert found.spectrum.swing_share > 0.5
            assert "lies around the swing's" in found.sentences["spectrum"]
    assert any(analysed(band / band.std(), late).spectrum.line is None for band in bands)
    assert abs(analysed(white(), late).spectrum.swing_share) < 0.1


def test_the_spectrum_adds_up_to_the_variance():
    for n in (1000, 1001):
        e = ar1(0.9, n=n)
        f, S = power_spectrum(e, STEP)
        assert np.sum(S) * f[1] == pytest.approx(e.var(), rel=2e-3)


# --- normality -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("draw", "words"), [
    (lambda g: g.standard_t(3, N), "with heavy tails"),
    (lambda g: g.laplace(size=N), 'cost = "huber"'),
    (lambda g: g.exponential(size=N), "longer above than on the other side"),
    (lambda g: -g.exponential(size=N), "longer below than on the other side"),
    (lambda g: g.uniform(size=N), "with cut tails"),
    (lambda g: np.sin(2 * np.pi * g.uniform(size=N)), "Rounding or a residual swing looks like this"),
])  # fmt: skip
def test_a_shape_that_is_not_normal_is_named(draw, words):
    e = 1e-3 * draw(rng())
    found = analysed(e - e.mean())
    assert found.whiteness.white
    assert found.normality.ppcc < 0.985
    assert found.normality.p_value < 1e-3
    assert found.sentences["normality"].startswith("Not normal: PPCC")
    assert words in found.sentences["normality"]


def test_a_shape_that_is_hardly_off_is_normal_enough_however_many_samples_see_it():
    found = analysed(1e-3 * rng().standard_t(12, N))
    assert found.normality.p_value < 0.05
    assert "is too small to matter" in found.sentences["normality"]


@pytest.mark.parametrize(("quantiles", "ppcc"), [
    (stats.laplace.ppf, 0.981),
    (lambda p: p, 0.977),
    (lambda p: np.sin(np.pi * (p - 0.5)), 0.949),
])  # fmt: skip
def test_the_bar_for_a_normal_shape_lies_above_what_is_none(quantiles, ppcc):
    (osm, ordered), _ = stats.probplot(quantiles((np.arange(N) + 0.5) / N))
    assert np.corrcoef(osm, ordered)[0, 1] == pytest.approx(ppcc, abs=1e-3)
    assert ppcc < NORMAL


def test_the_shapes_figures_are_those_of_scipy_and_statsmodels():
    from statsmodels.stats.diagnostic import normal_ad

    e = 1e-3 * rng().standard_t(5, 3000)
    found = analysed(e)
    k = found.whiteness.thinning
    assert found.normality.ppcc == pytest.approx(stats.probplot(e)[1][2])
    assert found.normality.excess_kurtosis == pytest.approx(stats.kurtosis(e))
    assert (found.normality.anderson_darling, found.normality.p_value) == pytest.approx(normal_ad(e[::k]))


@pytest.mark.parametrize("spread", [0.1, 0.5, 1.0, 3.0])
def test_the_tests_of_shape_and_variance_are_those_of_statsmodels(spread):
    from statsmodels.stats.diagnostic import het_breuschpagan, normal_ad

    by = np.linspace(0.0, 1.0, 400)
    e = rng().normal(size=400) * (1.0 + spread * by) ** 2
    assert anderson_darling(e) == pytest.approx(normal_ad(e))
    exogenous = np.column_stack([np.ones_like(by), by])
    assert breusch_pagan(e, by) == pytest.approx(het_breuschpagan(e - e.mean(), exogenous)[1])


def test_too_few_independent_samples_are_given_no_p_value():
    found = analysed(ar1(0.999))
    assert found.whiteness.thinned_samples < 20
    assert np.isnan(found.normality.p_value)
    assert "samples two correlation times apart are too few to test" in found.sentences["normality"]


# --- variance --------------------------------------------------------------------------------------

DECAY = 0.3 * np.exp(-TIME / 5) * np.cos(2 * np.pi * SWING * TIME)
RAMP = TIME / 20
"""Everywhere as fast."""
TURNS = (600, 300, 600)
PHASE = np.cumsum(STEP * np.tile(np.repeat([1.0, 2.0, 3.0], TURNS), 14)[:N])
TRIANGLES = np.abs(PHASE % 2 - 1)
"""Everywhere as near and far, as early and late; slow, faster and fast by turns."""
SPEED = np.tile(np.repeat([0.0, 0.5, 1.0], TURNS), 14)[:N]
FAR = np.abs(RAMP - 0.5) / 0.5


@pytest.mark.few(6)
@pytest.mark.parametrize(("scale", "fitted", "which", "ratio", "words"), [
    (1 + 4 * RAMP, TRIANGLES, 0, 4.333 / 1.667, "in the last third of the record as in the first"),
    (1 + 4 * RAMP, TRIANGLES, 0, 4.333 / 1.667, "the swing's phase or damping runs off"),
    (5 - 4 * RAMP, TRIANGLES, 0, 1.667 / 4.333, "what is missing shows while the swing is large"),
    (1 + 4 * FAR, RAMP, 1, 4.333 / 1.667, "far from the middle as near it"),
    (1 + 4 * FAR, RAMP, 1, 4.333 / 1.667, "the scale of the encoder, or a term of large angles"),
    (5 - 4 * FAR, RAMP, 1, 1.667 / 4.333, "friction at the small end, or dead play"),
    (1 + 4 * SPEED, TRIANGLES, 2, 5, "when fast as when slow"),
    (1 + 4 * SPEED, TRIANGLES, 2, 5, "the recording's clock or a delay"),
    (5 - 4 * SPEED, TRIANGLES, 2, 0.2, "sticking at the turning points"),
])  # fmt: skip
@pytest.mark.parametrize("noise", [white, lambda: ar1(0.8)], ids=["white", "AR(1)"])
def test_a_spread_that_changes_is_told_with_where_and_by_how_much(scale, fitted, which, ratio, words, noise):
    found = analysed(noise() * scale, fitted)
    contrast = found.variance.contrasts[which]
    assert contrast.ratio == pytest.approx(ratio, rel=0.1)
    assert contrast.p_value < 1e-3
    assert [c.sure for c in found.variance.contrasts] == [i == which for i in range(3)]
    assert f"The residual's rms is {contrast.ratio:.2g} times as large" in found.sentences["variance"]
    assert words in found.sentences["variance"]
    assert "intervals allow for it" in found.sentences["variance"]


def test_of_a_swing_that_is_slow_where_it_is_far_the_larger_side_is_named():
    speed = np.abs(np.gradient(FITTED))
    found = analysed(white() * (1 + 4 * speed / speed.max()))
    assert found.variance.far_to_near.sure  # and smaller
    assert "the recording's clock or a delay, or friction that grows with speed" in found.sentences["variance"]


def test_where_the_motion_dies_away_what_is_missing_shows_in_large_swings():
    found = analysed(white() * np.exp(-TIME / 5), DECAY)
    assert found.variance.far_to_near.sure
    assert "what is missing shows while the swing is large: friction" in found.sentences["variance"]


def test_heavy_tails_of_a_spread_that_changes_are_put_down_to_it():
    found = analysed(white() * np.exp(-TIME / 4), DECAY)
    assert found.normality.ppcc < 0.985
    assert "A spread that changes looks so: see the variance" in found.sentences["normality"]


def test_a_spread_that_changes_a_little_within_few_independent_samples_may_be_chance():
    found = analysed(ar1(0.999, seed=2) * (1 + 4 * TIME / 20))
    assert found.whiteness.thinned_samples < 20
    assert (
        f"that may be chance: the residual is worth {found.whiteness.effective_samples:.0f} independent samples"
        in found.sentences["variance"]
    )


def test_a_spread_that_changes_twentyfold_is_no_chance_even_within_few():
    swings = np.exp(-TIME / 3) * np.sin(2 * np.pi * SWING * TIME + 1)
    found = analysed(1e-3 * swings + 0.01 * white(), DECAY)
    assert found.whiteness.thinned_samples < 20
    assert found.variance.late_to_early.ratio < 0.05
    assert found.variance.late_to_early.sure


@pytest.mark.broad
def test_few_samples_that_count_call_a_ratio_no_chance_as_seldom_as_they_should():
    contrasts = [c for seed in range(40) for c in analysed(ar1(0.998, seed)).variance.contrasts]
    assert np.mean([c.p_value < 0.05 for c in contrasts]) < 0.12


def test_a_motionless_fit_has_no_contrast_over_its_value_and_speed():
    late, far, fast = analysed(white(), np.full(N, 0.1)).variance.contrasts
    assert np.isfinite(late.ratio)
    assert np.isnan([far.ratio, far.p_value, fast.ratio, fast.p_value]).all()


# --- level -----------------------------------------------------------------------------------------


def measured_by_an_encoder(signal, noise):
    return ENCODER * np.round((signal + noise) / ENCODER) - signal


@pytest.mark.parametrize("residual", [
    wave(SWING, 0.6), wave(2 * SWING, 0.6), wave(3 * SWING, 0.6), np.cumsum(white()), white() * (1 + 4 * FAR),
    np.round(white() / 1e-3) * 1e-3,
])  # fmt: skip
def test_of_a_signal_that_is_no_angle_nothing_is_said_that_a_rig_alone_has(residual):
    sentences = residual_analysis(replace(twin(residual), units={"alpha": "V"}), "alpha", {"alpha": 1e-3}).sentences
    assert not re.findall("encoder|angle|Coulomb|presliding|cable|axis|joint", " ".join(sentences.values()))


def test_rounding_alone_is_the_encoders_floor_and_no_better_model_is_seen():
    found = analysed(measured_by_an_encoder(FITTED, 0), resolution={"alpha": ENCODER})
    assert found.level.floor == pytest.approx(ENCODER / np.sqrt(12))
    assert found.level.rms == pytest.approx(found.level.floor, rel=0.05)
    assert "This encoder cannot distinguish a better model" in found.sentences["level"]


def test_the_rounding_of_a_slow_motion_is_correlated_and_no_fault_of_the_model():
    slow = 0.02 * np.sin(2 * np.pi * 0.2 * TIME)
    found = analysed(measured_by_an_encoder(slow, 0), slow, {"alpha": ENCODER})
    assert not found.whiteness.white
    assert "that is the rounding of a slow motion" in found.sentences["whiteness"]


@pytest.mark.parametrize(("times", "rounding"), [(1.5, True), (2.5, False)])
def test_a_residual_that_rounding_may_explain_is_put_down_to_it_by_every_sentence(times, rounding):
    e = analysed(times * ENCODER / np.sqrt(6) * np.sin(2 * np.pi * 0.7 * TIME), resolution={"alpha": ENCODER})
    assert (e.level.rounding, e.whiteness.white) == (rounding, False)
    assert ("no fault of the model" in e.sentences["whiteness"]) is rounding
    assert ("cannot distinguish a better model" in e.sentences["level"]) is rounding
    assert ("the model lacks something" in e.sentences["whiteness"]) is not rounding


@pytest.mark.parametrize(
    ("noise", "words"),
    [
        (0.4, "0.49 steps of the encoder: rounding alone leaves 0.29. This encoder cannot distinguish a better model"),
        (3.0, "10 times what rounding leaves: it is noise, not the encoder"),
    ],
)
def test_the_spread_is_told_in_steps_of_the_encoder(noise, words):
    found = analysed(measured_by_an_encoder(FITTED, noise * ENCODER * rng().standard_normal(N)))
    with_step = analysed(measured_by_an_encoder(FITTED, noise * ENCODER * rng().standard_normal(N)),
                         resolution={"alpha": ENCODER})  # fmt: skip
    assert "No rounding is seen" in found.sentences["level"]
    assert with_step.level.steps == pytest.approx(np.hypot(noise, 1 / np.sqrt(12)), rel=0.03)
    assert re.search(words, with_step.sentences["level"])


def test_the_encoders_step_is_found_in_the_samples_where_none_is_given():
    e = measured_by_an_encoder(FITTED, 3 * ENCODER * rng().standard_normal(N))
    assert residual_analysis(twin(e), "alpha").level.encoder_step == pytest.approx(ENCODER)


def test_a_constant_part_is_told():
    found = analysed(white() + 2e-3)
    assert "of which a constant 0.11°: an angle's zero or rest is off" in found.sentences["level"]
    assert "constant" not in analysed(white()).sentences["level"]


# --- what a p-value is worth -----------------------------------------------------------------------

SEEDS = 60


@pytest.mark.broad
@pytest.mark.parametrize("correlation", [0.0, 0.9], ids=["white", "AR(1)"])
def test_p_values_are_uniform_where_nothing_is_wrong(correlation):
    found = [analysed(ar1(correlation, seed, n=6000)) for seed in range(SEEDS)]
    for values in (
        [a.whiteness.thinned_p_value for a in found],
        [a.normality.p_value for a in found],
        *([a.variance.contrasts[i].p_value for a in found] for i in range(3)),
    ):
        assert stats.kstest(values, "uniform").pvalue > 1e-3
        assert np.sum(np.array(values) < 0.05) <= stats.binom.ppf(0.9995, SEEDS, 0.05)


def test_on_all_of_many_correlated_samples_a_p_value_rejects_good_noise():
    assert np.mean([anderson_darling(ar1(0.98, seed))[1] < 0.05 for seed in range(20)]) > 0.8


# --- what it does not depend on --------------------------------------------------------------------


@pytest.mark.parametrize("size", [1e-9, 1e-3, 1e3])
def test_the_verdicts_do_not_depend_on_the_size_of_the_residual(size):
    e, fitted = ar1(0.9), FITTED
    one, other = analysed(e, fitted), analysed(size * e, fitted)
    assert [*one.sentences.values()][:4] == [*other.sentences.values()][:4]


def test_a_recordings_own_clock_does_not_matter():
    e = ar1(0.9)
    shifted = residual_analysis(replace(twin(e), time=123.4 + TIME), "alpha", NOWHERE)
    assert shifted.sentences == analysed(e).sentences


# --- odd residuals ---------------------------------------------------------------------------------

ODD = {
    "none": (np.full(100, np.nan), "There is no residual: the simulation failed"),
    "empty": (np.empty(0), "There is no residual"),
    "short": (white(n=29), "29 samples are too few to test; 30 are the least"),
    "two": (np.array([0.1, 0.2]), "2 samples are too few to test"),
    "perfect": (np.zeros(100), "nothing is left to test"),
    "rounding": (1e-17 * rng().standard_normal(100), "nothing is left to test"),
    "offset": (np.full(100, np.radians(0.5)), "All 100 residuals are 0.5°"),
    "cut short": (
        np.append(white(n=20), np.full(500, np.nan)),
        "20 samples have a fitted value, and these are too few",
    ),
}


@pytest.mark.parametrize(("residual", "words"), ODD.values(), ids=ODD)
def test_what_cannot_be_tested_is_told_and_has_no_figures(residual, words):
    fitted = np.where(np.isnan(residual), np.nan, 0.3)
    recording = twin(residual, fitted, measured={"alpha": 0.3 + np.nan_to_num(residual)})
    found = residual_analysis(recording, "alpha", NOWHERE)
    assert words in found.sentences["whiteness"]
    assert set(found.sentences) <= {"whiteness", "level"}
    assert found.to_json()["whiteness"]["correlation_time"] is None
    json.dumps(found.to_json(), allow_nan=False)


def test_of_a_residual_with_a_gap_the_longest_stretch_is_looked_at():
    e = ar1(0.9)
    e[:5000], e[9000:9010] = np.nan, np.nan
    found = analysed(e)
    assert (found.samples, found.missing) == (N - 9010, 9010)
    assert found.sentences == analysed(e[9010:], FITTED[9010:]).sentences


@settings(max_examples=20)
@given(hnp.arrays(float, st.integers(0, 120), elements=st.floats(-1e3, 1e3), fill=st.floats(-1, 1)))
def test_any_residual_is_told_of_without_a_nan(residual):
    found = analysed(residual)
    assert "nan" not in " ".join(found.sentences.values()).lower()
    assert all(sentence.endswith(".") for sentence in found.sentences.values())
    json.dumps(found.to_json(), allow_nan=False)


def test_a_callers_mistakes_are_told():
    with pytest.raises(InputError, match="unknown output of twin 'beta'"):
        residual_analysis(twin(white()), "beta")
    uneven = TIME + 1e-4 * rng().uniform(size=N)
    with pytest.raises(InputError, match="s apart; a residual's correlation in time needs them evenly spaced"):
        residual_analysis(replace(twin(white()), time=uneven), "alpha")


def test_uneven_samples_are_taken_one_after_the_other_and_not_asked_for_frequencies():
    uneven = residual_analysis(replace(twin(white()), time=np.geomspace(1e-3, 20.0, N), uneven=True), "alpha")
    assert uneven.whiteness.white
    assert "spectrum" not in uneven.sentences


def test_it_is_a_public_name():
    assert fracid.residual_analysis is residual_analysis


# --- the page of figures ---------------------------------------------------------------------------


def words(figure):
    return "\n".join(text.get_text() for text in figure.findobj(Text))


def test_the_page_has_seven_panels_with_units_on_every_axis():
    figure = residual_diagnostics(twin(ar1(0.9)), "alpha")
    headings = [axes.get_title() for axes in figure.axes]
    assert headings[:4] == ["over time", "against the fitted value", "against the fitted speed", "distribution"]
    assert headings[4].startswith("normal probability, PPCC")
    assert headings[5].startswith("autocorrelation: ")
    assert headings[6] == "spectrum: no frequency stands out"
    for axes in figure.axes:
        for label in (axes.get_xlabel(), axes.get_ylabel()):
            assert label.endswith("]"), label


def test_the_page_shows_what_the_analysis_says():
    e = wave(2 * SWING, 0.6)
    found = analysed(e)
    said = words(residual_diagnostics(twin(e), "alpha", analysis=found))
    assert f"autocorrelation: {found.whiteness.effective_samples:,.0f} of 20,000 samples count" in said
    assert f"spectrum: {100 * found.spectrum.line.share:.0f} % at 3 Hz" in said
    for label in ("95 % of white noise", "correlation time", "the swing and its multiples"):
        assert label in said
    assert "rounding of the encoder" not in said


def test_the_encoders_step_is_drawn_over_time_and_its_rounding_in_the_spectrum():
    e = measured_by_an_encoder(FITTED, 2 * ENCODER * rng().standard_normal(N))
    figure = residual_diagnostics(twin(e), "alpha", resolution={"alpha": ENCODER})
    assert "± ½ encoder step of 0.0879°" in words(figure)
    spectrum = figure.axes[6]
    floor = next(line for line in spectrum.lines if line.get_label() == "rounding of the encoder alone").get_ydata()[0]
    assert floor * 0.5 / STEP == pytest.approx(np.degrees(ENCODER) ** 2 / 12, rel=1e-3)


@pytest.mark.broad
def test_a_histograms_bins_are_no_narrower_than_the_encoders_steps_that_it_shows():
    rest = measured_by_an_encoder(np.zeros(N), 3 * ENCODER * rng().standard_normal(N))  # a residual on a lattice
    panel = residual_diagnostics(twin(rest, np.zeros(N)), "alpha", resolution={"alpha": ENCODER}).axes[3]
    values, edges, _ = next(patch for patch in panel.patches if isinstance(patch, StepPatch)).get_data()
    np.testing.assert_allclose(np.diff(edges), np.degrees(ENCODER))
    assert np.sum(values * np.diff(edges)) == pytest.approx(1)
    assert np.count_nonzero(np.diff(np.sign(np.diff(values)))) <= 3  # it rises and falls: no comb


@pytest.mark.few(1)
@pytest.mark.parametrize("residual", [residual for name, (residual, _) in ODD.items() if name != "empty"],
                         ids=[name for name in ODD if name != "empty"])  # fmt: skip
def test_odd_residuals_are_drawn_and_named(residual):
    fitted = np.where(np.isnan(residual), np.nan, np.linspace(0, 0.3, residual.size))
    figure = residual_diagnostics(twin(residual, fitted, measured={"alpha": fitted + residual}), "alpha")
    said = words(figure)
    assert "the simulation failed" in said if np.all(np.isnan(residual)) else "nothing that can be tested" in said
    figure.savefig(io.BytesIO(), dpi=20)


@pytest.mark.broad
def test_the_file_is_small(tmp_path):
    (svg,) = save(residual_diagnostics(twin(ar1(0.9), DECAY), "alpha"), tmp_path, "page", ("svg",))
    assert svg.stat().st_size < 700_000
