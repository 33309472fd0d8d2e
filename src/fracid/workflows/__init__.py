"""Workflows: load, compute, write the run folder; what a command does, to be called from Python too."""
