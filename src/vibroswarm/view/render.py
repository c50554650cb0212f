"""Draw a MuJoCo scene without a display: ``python -m vibroswarm.view.render SCENE.xml WIDTH HEIGHT OUT.rgb``.

This is a program of its own for two reasons. MuJoCo chooses its OpenGL library (``MUJOCO_GL``: egl or osmesa) only once
per process, and a driver that fails may end the process.
"""

from __future__ import annotations

import sys
from pathlib import Path


def main(scene: str, width: str, height: str, out: str) -> None:
    """Draw a scene with its first camera, and write the pixels: top row first, three bytes (RGB) each.

    Args:
        scene: MJCF file. width, height: in pixels. out: file to write.
    """
    import mujoco

    model = mujoco.MjModel.from_xml_path(scene)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    # Room for all geoms of the scene, and for some that MuJoCo may add.
    renderer = mujoco.Renderer(model, int(height), int(width), max_geom=model.ngeom + 100)
    renderer.update_scene(data, camera=0)
    Path(out).write_bytes(renderer.render().tobytes())
    renderer.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
