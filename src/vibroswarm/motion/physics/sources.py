"""The motion sources that MuJoCo moves; MuJoCo itself is loaded when one of them is used."""

from __future__ import annotations

from functools import partial
from typing import Final

from vibroswarm.motion.kernel_run import batch_of
from vibroswarm.motion.physics.planar import PlanarRun
from vibroswarm.motion.physics.wheels_model import LENGTH_M, WIDTH_M
from vibroswarm.motion.physics.wheels_run import WheelsRun
from vibroswarm.motion.source import Source, Tolerance, register

PLANAR: Final = register(
    Source(
        "mujoco-planar",
        PlanarRun,
        partial(batch_of, PlanarRun),
        "discs in MuJoCo: mass, finite forces, contact",
        tolerance=Tolerance(overlap_m=0.0005, arc=0.001, stop_m=0.02, stop_rad=0.02),
        robot_s=0.1,
        is_ours=True,
    )
)
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
