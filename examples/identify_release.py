"""Identify a release from a recording, with the library.

    python examples/identify_release.py     # prints what was found, draws identify_release.png

The recording is a twin that fracid ships: simulated with λ = 0.8623 and μ = 0.9146, released from 10°, 20 s at 1000 Hz,
read by encoders of 4096 counts a turn with 0.15° of noise.  The project file beside it says what is known and what is
free; for one of your own type `fracid init RECORDING`, and see README.md for what such a file says.
"""

from importlib.resources import files
from pathlib import Path

import fracid

PROJECT = files("fracid") / "twins" / "reference-twin.toml"
TRUTH = {"lambda": 0.8623, "mu": 0.9146}


def main():
    project = fracid.load_project(PROJECT)
    (recording,) = project.recordings
    print(recording.report.verdict)  # is it worth anything?

    fit = fracid.identify(project)
    print(f"{fit.outcome} after {fit.evaluations} evaluations")
    for name, order in fit.orders.items():
        low, high = order.interval95
        print(
            f"{name:6} {order.value:.5f}   95 %: {low:.5f} to {high:.5f}   truth {TRUTH[name]:g}   {order.identifiable}"
        )
    for warning in fit.warnings:
        print(f"! {warning}")

    # Is it the equation, or the step?  Is it the order, or a friction that the model lacks?
    shift = max(abs(moved) for moved in fit.discretisation.shift.values())
    print(f"at half the step the orders move by {shift:.1g}")
    alternative = fit.alternative
    print(f"the integer-order model with free friction has {alternative.cost / fit.cost:.1f} times the error")

    # Are the residuals noise?
    (result,) = fit.recordings.values()
    for output in result.measured:
        analysis = fracid.residual_analysis(result, output)
        print(f"{output}: {analysis.sentences['level']} {analysis.sentences['whiteness']}")

    fit.plot().savefig(Path(__file__).with_suffix(".png"), dpi=120)


if __name__ == "__main__":
    main()
