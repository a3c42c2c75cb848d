"""``python -m benchmark.studies.calibration``."""

import sys

from benchmark.studies.calibration.run import main

sys.exit(main())
