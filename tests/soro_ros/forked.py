"""A program for forks: it does what its first argument says."""

import os
import signal
import sys
import time


def main() -> int:
    """Entry point."""
    print(
        f"{os.getpid()} {os.getppid()} {os.getsid(0)} {os.environ.get('SORO_PULSE', '')} {sys.argv[1:]}",
        flush=True,
    )
    match sys.argv[1]:
        case "fail":
            raise ValueError("no such thing")
        case "exit":
            sys.exit(int(sys.argv[2]))
        case "read":
            print(os.read(int(os.environ["SORO_PULSE"]), 10).decode())
        case "wait":
            signal.signal(signal.SIGTERM, lambda *_: sys.exit(7))
            print("waits", flush=True)
            time.sleep(100)
    return 0


if __name__ == "__main__":
    sys.exit(main())
