"""Do FMUs open in a tool beside FMPy?  Errors of FMPy and of libcosim, of each state's range:  pip install libcosimpy

400 steps of 10 ms with held inputs, as tests/export/test_fmu.py has them; FMI 2.0, which libcosim reads.
"""

import sys
import tempfile
from pathlib import Path

import fmpy
import numpy as np

TESTS = Path(__file__).parents[1] / "tests"
sys.path[:0] = [str(TESTS / "export"), str(TESTS / "helpers")]
import test_fmu as units  # noqa: E402


def by_libcosim(path, problem):
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimManipulator import CosimManipulator
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    places = {v.name: v.valueReference for v in fmpy.read_model_description(str(path)).modelVariables}
    run = CosimExecution.from_step_size(step_size=round(1e9 * units.STEP))
    slave = run.add_local_slave(CosimLocalSlave(fmu_path=str(path), instance_name="one"))
    watch, hand = CosimObserver.create_last_value(), CosimManipulator.create_override()
    run.add_observer(watch)
    run.add_manipulator(hand)
    inputs, states = ([places[n] for n in names] for names in (problem.model.inputs, units.states(problem)))
    rows = []
    for u in problem.experiments[0].inputs[: units.STEPS]:
        if inputs:
            hand.slave_real_values(slave, inputs, u.tolist())
        run.step()
        rows.append(watch.last_real_values(slave, states))
    return np.array(rows)


if __name__ == "__main__":
    print("| model | FMPy | libcosim |\n|---|---|---|")
    for name in units.CASES:
        problem = units.problem_of(name, "hold")
        ours = problem.simulate(problem.start, problem.experiments[0]).states[1:]
        path = units.archive(Path(tempfile.mkdtemp()), problem)
        first = units.simulated(path, problem, units.states(problem), input=units.driven(problem))[1:]
        off = [(np.abs(x - ours).max(axis=0) / np.ptp(ours, axis=0)).max() for x in (first, by_libcosim(path, problem))]
        print(f"| {name} | {off[0]:.1e} | {off[1]:.1e} |", flush=True)
