"""Which experiment next: candidates, what each would tell of the free parameters, and the best few of them.

=====================  ==================================================================================
file                   holds
=====================  ==================================================================================
:mod:`.excitation`     voltages: multisine, chirp, pulses
:mod:`.space`          DesignSpace: what can be done on the rig; one Candidate of it
:mod:`.subject`        Subject: the model, its values, its noise, and what has been recorded already
:mod:`.information`    the information of one experiment about the shared parameters
:mod:`.criteria`       D, A, Ds, T of a set of experiments
:mod:`.exchange`       the best set of k candidates, by exchange
:mod:`.alternatives`   how far the best integer-order alternative stays from each candidate
:mod:`.choice`         design(): from a run, a project or a rig to a Plan
:mod:`.plan`           Plan: the experiments, the expected intervals; its sheet, projects and curves
=====================  ==================================================================================
"""
