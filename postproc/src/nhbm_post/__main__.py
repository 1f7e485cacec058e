"""Runs the command line with `python -m nhbm_post`."""

import sys

from .cli import main

sys.exit(main())
