"""Controllers of an identified model, and over which part of what is known of it they hold.

==================================  ====================================================================================
:mod:`fracid.feedback.regulators`       postures, the reduced model about one, regulators, margins
:mod:`fracid.feedback.pid`          PID and FOPID loops of the same effort
:mod:`fracid.feedback.swing`        swinging up, and the catch
:mod:`fracid.feedback.code`         the controller in C
:mod:`fracid.feedback.study`        the loop as it is found, draws of the unknowns, the design that holds on most
==================================  ====================================================================================
"""
