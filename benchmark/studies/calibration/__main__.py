"""``python -m surveilnav.benchmark.studies.calibration``."""

import sys

from surveilnav.benchmark.studies.calibration.run import main

sys.exit(main())
