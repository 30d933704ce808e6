import sys
from pathlib import Path

HERE = Path(__file__).parent
# Make the test helpers and the scripts next to the package importable.
sys.path[:0] = [str(HERE), str(HERE.parent)]
