import sys
from pathlib import Path

HERE = Path(__file__).parent
# The tests' own helpers, and the scripts beside the package.
sys.path[:0] = [str(HERE), str(HERE.parent)]
