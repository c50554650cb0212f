"""The walk in VMAS, a vectorised 2D simulator in PyTorch, with lidar: simulated seconds per CPU second of one core.

    pip install torch vmas        (in an environment of its own: torch is large)
    python benchmarks/vmas_lidar.py [--robots 5] [--environments 1000] [--seconds 60] [--json]

Robots walk like those of preset ``paper-empirical`` (clipped Cauchy legs, turns in place, avoidance by three rays,
stops to sample), all environments at once in tensors; bodies are discs that collide with each other and with walls by
VMAS's penalties. It is less work than the engine's: no gyro control, no misalignment, no messages, nothing written
down. To be held against ``stage_timing.py --peers`` on the same machine.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from typing import Any

TICK_S = 0.02
SPEED_M_S, TURN_RAD_S = 0.055, 2.9
STOP_S = 1.0
LEG_LOCATION_S, LEG_SCALE_S, LEG_S = 5.0, 15.0, (1.0, 30.0)
SAMPLE_S, AVOID_M = 2.0, 0.05
DRIVE, TURN, STOP = 0, 1, 2


def world(torch: Any, robots: int, environments: int) -> Any:
    """A square of 1 m with discs that have three rays, and four walls."""
    from vmas.simulator.core import Agent, Box, Landmark, Sphere, World
    from vmas.simulator.sensors import Lidar

    made = World(environments, torch.device("cpu"), dt=TICK_S, substeps=1, drag=0.0)
    for k in range(robots):
        rays = Lidar(made, math.radians(-27.0), math.radians(27.0), 3, 0.15, lambda entity: True)
        made.add_agent(Agent(f"robot {k}", shape=Sphere(0.015), sensors=[rays]))
    for k, (x_m, y_m, length_m, width_m) in enumerate(
        (
            (0.0, 0.505, 1.02, 0.01),
            (0.0, -0.505, 1.02, 0.01),
            (0.505, 0.0, 0.01, 1.02),
            (-0.505, 0.0, 0.01, 1.02),
        )
    ):
        wall = Landmark(f"wall {k}", shape=Box(length_m, width_m), collide=True, movable=False)
        made.add_landmark(wall)
        wall.set_pos(torch.tensor([[x_m, y_m]]).expand(environments, 2), batch_index=None)
    return made


class Walkers:
    """The program of one robot in all environments, in tensors of shape (environments,)."""

    def __init__(self, torch: Any, agent: Any, environments: int) -> None:
        self.torch, self.agent, self.n = torch, agent, environments
        agent.set_pos((torch.rand(environments, 2) - 0.5) * 0.9, batch_index=None)
        agent.set_rot(torch.rand(environments, 1) * 2 * math.pi, batch_index=None)
        self.phase = torch.full((environments,), DRIVE)
        self.leg_s, self.sample_s = self.leg(), torch.full((environments,), SAMPLE_S)
        self.left_s, self.turn = torch.zeros(environments), torch.ones(environments)
        self.samples = torch.zeros(environments)

    def leg(self) -> Any:
        """Clipped Cauchy legs, s."""
        u = self.torch.rand(self.n)
        return (LEG_LOCATION_S + LEG_SCALE_S * self.torch.tan(math.pi * (u - 0.5))).clamp(*LEG_S)

    def step(self) -> None:
        """Sense, decide, and set the velocities until the next tick."""
        torch = self.torch
        near = self.agent.sensors[0].measure().min(dim=-1).values < AVOID_M
        driving, moving = self.phase == DRIVE, self.phase != STOP
        self.leg_s = self.leg_s - TICK_S * driving
        self.sample_s = self.sample_s - TICK_S * moving
        self.left_s = self.left_s - TICK_S
        begins = moving & (self.sample_s <= 0)
        over = driving & (self.leg_s <= 0)
        turns = driving & (near | over) & ~begins
        angle = (2 * torch.rand(self.n) - 1) * math.pi
        self.turn = torch.where(turns, angle.sign(), self.turn)
        done = (self.phase != DRIVE) & (self.left_s <= 0) & ~begins
        self.samples += done & (self.phase == STOP)
        self.left_s = torch.where(turns, angle.abs() / TURN_RAD_S, self.left_s)
        self.left_s = torch.where(begins, torch.full_like(self.left_s, STOP_S), self.left_s)
        self.leg_s = torch.where(over, self.leg(), self.leg_s)
        self.phase = torch.where(done, DRIVE, self.phase)
        self.phase = torch.where(turns, TURN, self.phase)
        self.phase = torch.where(begins, STOP, self.phase)
        self.sample_s = torch.where(begins, torch.full_like(self.sample_s, SAMPLE_S), self.sample_s)
        heading = self.agent.state.rot[:, 0]
        speed = SPEED_M_S * (self.phase == DRIVE)
        self.agent.state.vel = torch.stack([speed * heading.cos(), speed * heading.sin()], dim=-1)
        self.agent.state.ang_vel = (TURN_RAD_S * self.turn * (self.phase == TURN)).unsqueeze(-1)


def main() -> None:
    options = argparse.ArgumentParser(description="The walk in VMAS with lidar, on one core.")
    options.add_argument("--robots", type=int, default=5)
    options.add_argument("--environments", type=int, default=1000)
    options.add_argument("--seconds", type=float, default=60.0, help="simulated seconds of each environment")
    options.add_argument("--json", action="store_true")
    given = options.parse_args()
    import torch
    import vmas

    torch.set_num_threads(1)
    torch.manual_seed(1)
    made = world(torch, given.robots, given.environments)
    walkers = [Walkers(torch, agent, given.environments) for agent in made.agents]
    for agent in made.agents:  # forces come from collisions alone
        agent.action.u = torch.zeros(given.environments, 2)
    steps = round(given.seconds / TICK_S)
    before_s = time.process_time()
    for _ in range(steps):
        for walker in walkers:
            walker.step()
        made.step()
    cpu_s = time.process_time() - before_s
    simulated_s = steps * TICK_S * given.environments
    escaped = sum(int((agent.state.pos.abs() > 0.5).any(dim=-1).sum()) for agent in made.agents)
    about = {
        "vmas": vmas.__version__ if hasattr(vmas, "__version__") else "?",
        "torch": torch.__version__,
        "robots": given.robots,
        "environments": given.environments,
        "simulated_s_per_cpu_s": simulated_s / cpu_s,
        "samples_per_robot_and_minute": float(
            sum(walker.samples.mean() for walker in walkers) / given.robots / (given.seconds / 60)
        ),
        "robots_outside_at_the_end": escaped,
    }
    if given.json:
        print(json.dumps(about, indent=2))
    else:
        print("\n".join(f"{name}: {value}" for name, value in about.items()))


if __name__ == "__main__":
    main()
