"""``python -m satgs.dask`` is the command ``satgs-dask``."""

import sys

from .cli import main

sys.exit(main())
