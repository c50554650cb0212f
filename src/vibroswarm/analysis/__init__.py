"""Numbers from results: outcomes, times, intervals. What is drawn is computed here.

| module | what of |
|---|---|
| ``verdict`` | one run |
| ``per_run``, ``swarm``, ``incidence`` | one cell: each run in a row, all figures with intervals, decisions over time |
| ``paired`` | two cells, run by run |
| ``tradeoff``, ``detection`` | many cells: time against error, how many robots for how long |
| ``sampling``, ``correlation`` | how a swarm samples |
| ``decidability`` | whether the question can be decided |
| ``pooled``, ``known`` | references beside a strategy |
| ``tile_counts``, ``both_sides`` | what ``known`` computes with, and is judged on |
| ``intervals`` | what all of them stand on |
"""
