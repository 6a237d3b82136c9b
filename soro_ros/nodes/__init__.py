"""The nodes, one program each: without the extra `ros` it ends with one line and exit status 2."""

import sys

from soro_core.extras import MissingPackageError, require

try:
    require("ros")
except MissingPackageError as error:
    sys.stderr.write(f"soro: {error}\n")
    raise SystemExit(2) from None
