"""vibroswarm: swarms of small robots that inspect a surface and decide together what it is like.

    from vibroswarm import preset, simulate, verdict

    result = simulate(preset("paper"), seed=7)
    print(verdict(result).consensus)

The public names are those of ``__all__``; each is imported when it is first used, so that importing the
package costs next to nothing.
"""

from vibroswarm.core.start import leave_working_folder_out

leave_working_folder_out(__path__[0])

import lazy_loader  # noqa: E402 - it must not be a file of the working folder

from vibroswarm.core.notebook_view import above  # noqa: E402 - as above


def _as_html(value: object) -> str:
    """Return what a notebook shows of an object; the module that writes it is imported when it is needed."""
    from vibroswarm.report.notebook import html_of

    return html_of(value)


above.update({"html": _as_html})

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
