"""The harness of public benchmarks: it trains on one file, is judged on another, and says where there is none."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

import fracid
from scripts import module_of

NOISE = 0.01
TRUTH = {"pump": 0.04, "k1": 0.04, "ratio": 1.25, "k3": 0.055, "part": 1.5}


@pytest.fixture(scope="module")
def public():
    """benchmarks/public.py, which is no package; it imports its neighbour."""
    return module_of("benchmarks/public.py")


def tanks(public, path, seed, samples=256):
    """A record of tanks whose constants are known, with overflow."""
    rng = np.random.default_rng(seed)
    time = 4.0 * np.arange(samples)
    u = 3.2 + sum(0.9 * np.sin(2 * np.pi * k * time / time[-1] + p) for k, p in enumerate(rng.uniform(0, 6, 5), 1))
    run = fracid.simulate(
        public.public_models.cascaded_tanks, orders={"q": 1.0}, parameters=TRUTH,
        initial={"upper": 5.0, "lower": 4.0}, step=0.5, end=time[-1], inputs=np.repeat(u, 8)[:-7, None],
    )  # fmt: skip
    y = np.minimum(run.states[::8, 1], 10.0) + NOISE * rng.standard_normal(samples)
    np.savetxt(path, np.column_stack([time, u, y]), delimiter=",", header="t,u,y", comments="")


@pytest.mark.broad
def test_a_model_of_the_training_file_predicts_the_test_file_to_its_noise(public, tmp_path, capsys):
    tanks(public, tmp_path / "cascaded_tanks_train.csv", 1)
    tanks(public, tmp_path / "cascaded_tanks_test.csv", 2)
    public.main(["--train", str(tmp_path), "--test", str(tmp_path), "--json"])
    out, said = capsys.readouterr()
    assert float(re.search(r"cascaded_tanks_test +(\S+) V", said)[1]) < 3 * NOISE
    test = json.loads(out)["cascaded_tanks_test"]
    assert test["rms"] < 3 * NOISE
    assert test["unit"] == "V"
    assert test["parameters"]["k3"]["value"] == pytest.approx(TRUTH["k3"], rel=0.2)
    assert "256 samples of training" in said
    assert "aside" not in said


@pytest.mark.broad
def test_without_a_test_file_the_end_of_the_training_is_kept_aside_and_said(public, tmp_path, capsys, monkeypatch):
    simplest = replace(public.BENCHMARKS["cascaded_tanks"], groups={})
    monkeypatch.setitem(public.BENCHMARKS, "cascaded_tanks", simplest)
    tanks(public, tmp_path / "cascaded_tanks_train.csv", 1)
    public.main(["--train", str(tmp_path), "--test", str(tmp_path), "cascaded_tanks"])
    said = capsys.readouterr().out
    assert "192 samples of training" in said
    assert "no cascaded_tanks_test*.csv; the last 64 samples of training, kept aside" in said
    assert float(re.search(r"cascaded_tanks_aside +(\S+) V", said)[1]) < 5 * NOISE


def test_the_arrow_is_scored_within_the_range_of_training_too(public):
    arrow = public.Record("silverbox_test_arrow", 1.6e-3, np.zeros(40_475), np.zeros(40_475))
    sizes = {part.name: len(part.y) for part in public.parts_of(public.BENCHMARKS["silverbox"], arrow)}
    assert sizes == {"silverbox_test_arrow": 40_475, "silverbox_test_arrow_no_extrapolation": 32_000}


def test_the_period_of_an_input_is_found_and_noise_has_none(public):
    rng = np.random.default_rng(1)
    once = rng.standard_normal(100)
    assert public.period(np.tile(once, 4) + 0.1 * rng.standard_normal(400)) == 100
    assert public.period(rng.standard_normal(400)) is None


def test_a_folder_without_training_records_is_told_in_one_sentence(public, tmp_path):
    with pytest.raises(SystemExit, match=r"No NAME_train\.csv in .*; say where with --train DIR"):
        public.main(["--train", str(tmp_path)])
