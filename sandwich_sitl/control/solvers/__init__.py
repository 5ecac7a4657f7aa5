"""Solvers behind the port `HorizonSolver`: each renames the tracking problem to its own form."""
