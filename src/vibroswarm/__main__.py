"""``python -m vibroswarm`` is the command ``vibroswarm``."""

import sys

from vibroswarm.cli import main

sys.exit(main())
