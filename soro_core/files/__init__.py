"""Files and folders: rows of CSV, values of YAML, folders that only this user writes to, compiled kernels."""
