"""Designs of linear elementary models, whose optima follow from the frequency response in closed form.

D^ν y = K u − a y at K = a = 1 has G(jω) = K/(z + a), z = (jω)^ν.  A sine of unit amplitude in white noise tells of the
parameters p as the real part of (∂G/∂p)(∂G/∂p)* does.
"""

from itertools import combinations_with_replacement

import numpy as np
import pytest

import fracid
from fracid.models import Model, Parameter


def rhs(t, x, u, p, out):
    out[0] = p[0] * u[0] - p[1] * x[0]


ELEMENTARY = Model(
    name="elementary", rhs=rhs, states=("y",), orders=("nu",), outputs={"y": 0}, inputs=("u",),
    parameters=(Parameter("K", "1", 1.0, "gain"), Parameter("a", "1", 1.0, "rate")), zero="", source="Malti",
)  # fmt: skip


def derivatives(omega, order):
    """∂G/∂(ν, K, a), shape (3, ...)."""
    z = (1j * omega) ** order
    return np.stack([-z * np.log(1j * omega) / (1 + z) ** 2, 1 / (1 + z), -1 / (1 + z) ** 2])


def sampled(frequency, order, rate):
    """The same of samples, between which the input is held: images at all multiples of the rate, shape (3, n)."""
    omega = 2 * np.pi * (frequency[:, None] + rate * np.arange(-400, 401))
    held = -np.expm1(-1j * omega / rate) * rate / (1j * omega)
    return (derivatives(omega, order) * held).sum(axis=-1)


def informations(frequency, order, rate, which):
    g = sampled(frequency, order, rate)[which]
    return np.einsum("in,jn->nij", g, g.conj()).real


def candidates(best, periods, width):
    """Frequencies with whole numbers of periods in one duration, and that duration [s]."""
    return best * np.arange(periods - width, periods + width + 1) / periods, periods / best


def planned(order, free, experiments, rate, frequencies, seconds, **options):
    sines = [fracid.Multisine(f, f, peak=1.0, lines=1) for f in frequencies.tolist()]
    space = fracid.DesignSpace(voltage=sines, seconds=seconds, rate=rate, counts=0, noise=0.01,
                               initial_state="held")  # fmt: skip
    plan = fracid.design(ELEMENTARY, space, experiments=experiments, free=free, orders={"nu": order}, **options)
    assert {c.voltage.peak for c in plan.experiments} == {1.0}
    return sorted(c.voltage.low for c in plan.experiments), plan


@pytest.mark.broad
@pytest.mark.parametrize(
    ("order", "band", "rate", "periods"),
    [(1.1, (0.08, 0.3), 20.0, 200), (0.5, (1.0, 3.0), 400.0, 500)],
)
def test_the_sine_that_narrows_an_order_most_is_at_the_frequency_of_the_closed_form(order, band, rate, periods):
    frequency = np.linspace(*band, 1001)
    gain = abs(sampled(frequency, order, rate)[0])
    best = frequency[np.argmax(gain)]
    assert frequency[50] < best < frequency[-50]
    (chosen,), plan = planned(order, ("nu",), 1, rate, *candidates(best, periods, 6), of=("nu",))
    assert chosen == pytest.approx(best, rel=0.01)
    samples = plan.experiments[0].samples
    assert plan.expected["nu"].standard_error == pytest.approx(0.01 / gain.max() * np.sqrt(2 / samples), rel=0.01)


@pytest.mark.broad
def test_the_sine_that_tells_order_and_gain_together_is_at_the_frequency_of_the_closed_form():
    frequency = np.linspace(0.05, 1.0, 1001)
    best = frequency[np.argmax(np.linalg.det(informations(frequency, 0.8, 20.0, [0, 1])))]
    assert 0.06 < best < 0.9
    (chosen,), _ = planned(0.8, ("nu", "K"), 1, 20.0, *candidates(best, 200, 12))
    assert chosen == pytest.approx(best, rel=0.01)


@pytest.mark.broad
def test_two_sines_that_tell_all_three_parameters_are_those_of_the_closed_form():
    frequency = np.arange(1, 81) / 40.0
    tables = informations(frequency, 0.8, 50.0, [0, 1, 2])
    pairs = [*combinations_with_replacement(range(len(frequency)), 2)]
    best = max(pairs, key=lambda pair: np.linalg.det(tables[pair[0]] + tables[pair[1]]))
    chosen, _ = planned(0.8, ("nu", "K", "a"), 2, 50.0, frequency, 400.0)
    assert chosen == pytest.approx(frequency[[*best]], rel=0.01)
