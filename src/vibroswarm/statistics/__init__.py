"""Compute figures from results: outcomes, times, intervals. Everything that is drawn is computed here.

| module | covers |
|---|---|
| ``verdict`` | one run; what its robots know |
| ``figures`` | all figures, each declared once: of runs, and of a cell with intervals |
| ``incidence`` | one cell: decisions over time |
| ``paired`` | two cells, run by run |
| ``best_group`` | which of several contestants may be best; Pareto fronts |
| ``sampling`` | how a swarm samples |
| ``decidability`` | whether the question can be decided |
| ``map_figures`` | maps of the floor, and how good they are |
| ``over_time`` | agreement and error over time; what robots report |
| ``intervals`` | confidence intervals for all of them |
"""
