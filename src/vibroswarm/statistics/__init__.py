"""Compute figures from results: outcomes, times, intervals. Everything that is drawn is computed here.

| module | covers |
|---|---|
| ``verdict`` | one run, in numbers and in sentences; whether a posterior is an estimate or an opinion |
| ``figures`` | all figures, each declared once; one row of them per run |
| ``cell_summary``, ``incidence`` | one cell: all figures with intervals, decisions over time |
| ``paired`` | two cells, run by run |
| ``detection`` | many cells: how many robots for how long |
| ``sampling`` | how a swarm samples |
| ``decidability`` | whether the question can be decided |
| ``map_scores``, ``map_figures`` | maps of the floor, and how good they are |
| ``answers_over_time``, ``robot_knowledge`` | agreement and error over time; what robots were told |
| ``intervals`` | confidence intervals for all of them |
"""
