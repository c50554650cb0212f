"""vibroswarm: swarms of small robots that inspect a surface and decide together what it is like.

    from vibroswarm import preset, simulate, verdict

    result = simulate(preset("paper"), seed=7)
    print(verdict(result).consensus)

The public names are those of ``__all__``; each is imported when it is first used, so that importing the
package costs next to nothing.
"""

import os
import sys


def _leave_working_folder_out() -> None:
    """Take the working folder off the search path where ``python -m vibroswarm`` has put it.

    Otherwise a file such as ``numpy.py`` in a folder of somebody else's data would be executed. The folder stays if
    this package itself was found in it, and for other programs, which may need modules of their own from there.
    """
    # While ``python -m`` looks for the module, argv is "-m" and the arguments.
    if sys.argv[:1] != ["-m"] or sys.flags.safe_path:
        return
    word = sys.orig_argv[
        -len(sys.argv)
    ]  # before the arguments: the module's name, or with its option, "-mNAME"
    module = word.partition("m")[2] if word.startswith("-") else word
    own_folder = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))  # noqa: PTH100, PTH120 - pathlib is slow
    if module.partition(".")[0] == __name__ and sys.path[:1] == [os.getcwd()] != [own_folder]:  # noqa: PTH109
        del sys.path[0]


_leave_working_folder_out()

import lazy_loader  # noqa: E402 - it must not be a file of the working folder either

from vibroswarm.core.displayed import makers, writers  # noqa: E402 - as above
from vibroswarm.study.verbs import providers  # noqa: E402 - as above


def _as_html(value: object) -> str:
    """Return what a notebook shows for a public object; the module that writes it is imported when it is needed."""
    from vibroswarm.documents.notebook import html_of

    return html_of(value)


def _as_document(value: object) -> object:
    """Return the document of a result; the module that makes it is imported when it is needed."""
    from vibroswarm.documents import document_of

    return document_of(value)


def _study_verbs() -> object:
    """Return the functions behind the methods of studies; their module is imported when it is needed."""
    from vibroswarm.study import study_outputs

    return study_outputs


writers.append(_as_html)
makers.append(_as_document)
providers.append(_study_verbs)

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
