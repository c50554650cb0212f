"""The motion source that MuJoCo moves; MuJoCo itself is loaded when it is used."""

from __future__ import annotations

from functools import partial
from typing import Final

from vibroswarm.motion.kernel_run import batch_of
from vibroswarm.motion.physics.wheels_model import LENGTH_M, WIDTH_M
from vibroswarm.motion.physics.wheels_run import WheelsRun
from vibroswarm.motion.source import Source, Tolerance, register

WHEELS: Final = register(
    Source(
        "mujoco",
        WheelsRun,
        partial(batch_of, WheelsRun),
        "robots on magnetic wheels in MuJoCo, with cones of rays",
        # arc: a robot that another pushes sideways at full speed (up to 1.5 x 55 mm/s) goes 1.7 mm in a control period.
        tolerance=Tolerance(overlap_m=0.001, arc=0.0017, stop_m=0.02, stop_rad=0.15),
        footprint_m=(LENGTH_M, WIDTH_M),
        robot_s=1.1,
        is_ours=True,
    )
)
