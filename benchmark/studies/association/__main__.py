"""``python -m surveilnav.benchmark.studies.association``."""

import sys

from surveilnav.benchmark.studies.association.run import main

sys.exit(main())
