"""Compute figures from results: outcomes, times, intervals. Everything that is drawn is computed here.

| module | covers |
|---|---|
| ``verdict`` | one run, in numbers and in sentences; whether a posterior is an estimate or an opinion |
| ``figures`` | all figures, each declared once: of runs, and of a cell with intervals |
| ``incidence`` | one cell: decisions over time |
| ``paired`` | two cells, run by run |
| ``detection`` | many cells: how many robots for how long |
| ``sampling`` | how a swarm samples |
| ``decidability`` | whether the question can be decided |
| ``map_scores``, ``map_figures`` | maps of the floor, and how good they are |
| ``answers_over_time``, ``robot_knowledge`` | agreement and error over time; what robots were told |
| ``intervals`` | confidence intervals for all of them |
"""
