"""``python -m hums``: the command line."""

import sys

from hums.cli import main

sys.exit(main())
