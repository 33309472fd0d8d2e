r"""Robust linear regression: the constants of the rotary pendulum straight from a recording, for given orders.

With :math:`x_2 = D^\lambda\theta`, :math:`x_4 = D^\mu\alpha` the equations (13) are linear in the lumped constants β.
Each sample gives two rows, the arm's and the pendulum's (with − C4 for ``zero = "upright"``); C3 and C6 stand in
both, every other constant in one:

.. math::

    (J_\theta + C_6 \sin^2\alpha)\, D^\lambda x_2 + C_3 (\cos\alpha\, D^\mu x_4 - \sin\alpha\, x_4^2)
       + C_6 \sin 2\alpha\, x_4 x_2 + b_\theta x_2 + f_\theta \tanh(x_2/v_s) &= \tau \\
    C_1 D^\mu x_4 + C_3 \cos\alpha\, D^\lambda x_2 - \tfrac12 C_6 \sin 2\alpha\, x_2^2
       + C_4 \sin\alpha + b_\alpha x_4 + f_\alpha \tanh(x_4/v_s) &= 0

or W β = 0, with the torque as one more column.  A free response therefore gives ratios only: one constant has
to be known, by name.

How the columns are made
    1. θ and α pass a zero-phase low-pass, whose cut-off the data's spectrum sets; a held value goes on into
       the past, as Caputo's derivative has it.  Being linear and time-invariant, the filter commutes with D^q.
    2. D^q of D^q (sequential), then the products.
    3. Every column passes the same smooth window, some 0.13 of a swing long, and the same decimation: both
       sides of an equation may be filtered alike.
    4. Borders are left out, all that a filter took from before the release or from after the end (so the filters
       are short), and so are the rows of an angle that hardly moves.

Noise in the columns is the difficulty, not noise in the equation: an acceleration from a 4096-count encoder makes
W itself wrong, and least squares then *shrinks* the inertias (errors in variables).

=========  ===================================================================================================
estimator  what it does
=========  ===================================================================================================
``ols``    least squares; shrinks
``huber``  Huber's M-estimator: outvotes bad samples, shrinks the same
``tukey``  Tukey's biweight, starting from Huber's: throws bad samples out, shrinks the same
``tls``    total least squares in the metric of the noise's own covariance in W, found by adding noise
``iv``     instrumental variables: the rows of the *simulated* response of the last estimate, free of noise,
           take the place of W on the left in Wᵀ W β = 0; with Huber's weights; repeated, over ever more swings
=========  ===================================================================================================

When to believe it
    Simulated SRV02 releases with viscous and dry friction, 6 s, 4096 counts at 1 kHz, orders given, C4 known; the
    largest errors over six zeros of the encoder [%], λ, μ = 1, 1 | 0.95, 0.97 | 0.8623, 0.9146
    (``python benchmarks/evidence.py regression`` prints them again):

    =======  ==================  ==================  =================  ==============  =========================
    release  ``iv``: J_theta,    C6                  b_theta,           b_alpha         least squares: J_theta
             C3, C1                                  coulomb_theta                      (its own bias estimate)
    =======  ==================  ==================  =================  ==============  =========================
    10°      9 | 14 | 12         100 and more        12 | 21 | 15       85 and more     −53 (−59) | −46 | −39
    30°      2.4 | 4.6 | 12      2.6 | 7.9 | 9.2     3.2 | 5.8 | 12     17 | 52 | 125   −23 (−20) | −19 | −23
    60°      0.3 | 1.0 | 0.7     0.8 | 0.8 | 1.7     2.6 | 2.8 | 2.4    5 | 12 | 11     −0.3 | −0.8 | −1.2
    90°      0.5 | 0.3 | 0.2     0.8 | 2.3 | 2.7     2.0 | 2.1 | 3.4    4 | 5 | 9       0.1 | −0.1 | −0.6
    =======  ==================  ==================  =================  ==============  =========================

    So: inertias and arm friction from 30° on, at orders far from 1 from 60° on; b_alpha from 60° on; coulomb_alpha
    (2.5·10⁻⁴ N m, 0.1 % of gravity's torque) to 20–50 % only; C6, which acts as α³, not at 10°.  Orders, when searched:
    within 0.004 from 60° on, 0.02 at 30° (intervals ± 0.06), the inertias then within 3 and 12 %; not at 10°: there
    the profile is flat, and no constant is called identified.
    Each value carries a standard error (of correlated residuals) *and* a bias estimated by adding the noise once
    more (SIMEX), at the size that explains the residual, and a verdict that weighs both.  Neither knows of what
    the model lacks: on a real SRV02 whose arm sticks, C1 agrees with an output-error fit within 2 %, the arm's
    constants come out 10 to 20 % lower, and the orders at 1.04 instead of 1.01.  The regression starts an
    output-error fit (:func:`start_values`); it does not replace it.

Orders are searched outside (variable projection): for each pair the constants are projected out by ``tls``, and
what is minimised is the residual against that which the noise in the columns explains, a ratio of 1 at the truth.
The residual itself would not do: its unit changes with the orders, and noise shrinks with them.

References
----------
.. [Gautier] M. Gautier, *Numerical calculation of the base inertial parameters of robots*, J. Robotic Systems 8
   (1991): base parameters by pivoted QR; parallel decimation of all columns.
.. [Janot] A. Janot, P.-O. Vandanjon, M. Gautier, *A generic instrumental variable approach for industrial robot
   identification*, IEEE Trans. Control Systems Technology 22 (2014): instruments from the simulated response.
.. [Cook] J. R. Cook, L. A. Stefanski, *Simulation-extrapolation estimation in parametric measurement error models*,
   J. American Statistical Association 89 (1994): SIMEX.
"""

from fracid.regression.linear import Constant as Constant
from fracid.regression.linear import Regression as Regression
from fracid.regression.linear import regress as regress
from fracid.regression.linear import start_of as start_of
from fracid.regression.linear import start_values as start_values
from fracid.regression.rows import LUMPED as LUMPED
from fracid.regression.rows import TERMS as TERMS
