"""Draw a scene of MuJoCo without a display: ``python -m vibroswarm.view.render SCENE.xml WIDTH HEIGHT OUT.rgb``.

A program of its own, since MuJoCo and OpenGL choose how to draw once per process (``MUJOCO_GL``: egl or osmesa), and
since a driver that fails may end the process.
"""

from __future__ import annotations

import sys
from pathlib import Path


def main(scene: str, width: str, height: str, out: str) -> None:
    """Write the pixels, top row first, three bytes each; the camera is the scene's first."""
    import mujoco

    model = mujoco.MjModel.from_xml_path(scene)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    renderer = mujoco.Renderer(model, int(height), int(width), max_geom=model.ngeom + 100)
    renderer.update_scene(data, camera=0)
    Path(out).write_bytes(renderer.render().tobytes())
    renderer.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
