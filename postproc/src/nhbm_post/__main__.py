"""Runs the command line with `python -m nhbm_post`."""

import sys

from .guard import guarded_main

sys.exit(guarded_main())
