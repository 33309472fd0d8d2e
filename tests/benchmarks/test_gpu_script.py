"""The loop that benchmarks/gpu.py compiles for a GPU, in Numba's simulator of one."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "benchmarks/gpu.py"


@pytest.mark.broad
def test_a_run_on_a_gpu_has_the_states_of_one_on_the_processor():
    pytest.importorskip("numba.cuda", reason="this Numba has no CUDA, and so no simulator of it")
    ran = subprocess.run(
        [sys.executable, SCRIPT],
        env=os.environ | {"NUMBA_ENABLE_CUDASIM": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    runs, error, early = re.search(r"(\d+) runs: .* error (\S+), (\d+) ended early", ran.stdout).groups()
    assert (int(runs), int(early)) == (2, 0)
    assert float(error) < 1e-13
