"""vibroswarm: swarms of small robots that inspect a surface and decide together what it is like.

    from vibroswarm import preset, simulate, verdict

    result = simulate(preset("paper"), seed=7)
    print(verdict(result).consensus)

The public names are those of ``__all__``; each is imported when it is first used, so that importing the
package costs next to nothing.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
