import sys
from pathlib import Path

import pytest

raise SystemExit(pytest.main([str(Path(__file__).parent), *sys.argv[1:]]))
