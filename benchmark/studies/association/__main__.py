"""``python -m benchmark.studies.association``."""

import sys

from benchmark.studies.association.run import main

sys.exit(main())
