"""A person on the host of the twin, while the cable to the controller's host is cut for a second.

``python -m tests.soro_ros.cut_cable TWIN...``: the command starts the twin. Prints what was seen, as JSON.
"""

from __future__ import annotations

import json
import subprocess
import sys

from tests.patience import COMPILED_S
from tests.soro_ros.arm_watch import ArmWatch

CUT_S = 1.0


def cable(state: str) -> None:
    """Plug the cable in (up) or out (down)."""
    subprocess.run(["ip", "link", "set", "cable0", state], check=True)


def main() -> None:
    """Start, cut, wait, recover."""
    twin = subprocess.Popen(sys.argv[1:])
    watch = ArmWatch("hosts", "twin")
    try:
        names = ("twin", "estimator", "controller")
        watch.until(lambda: all(map(watch.supervisor.active, names)), "both hosts", COMPILED_S)
        watch.call("controller/enable")
        watch.until(watch.under_control, "control over the cable")
        watch.supervisor.spin(CUT_S)
        before = watch.latched()
        cable("down")
        watch.supervisor.spin(CUT_S)
        cut = watch.latched()
        cable("up")
        watch.supervisor.status.pop("controller")
        watch.until(lambda: "controller" in watch.supervisor.status, "the controller again")
        watch.until(watch.empty, "an empty arm")
        again = watch.latched()
        watch.recover()
        watch.until(watch.under_control, "control again")
        print(json.dumps({"before": before, "cut": cut, "again": again}), flush=True)
    finally:
        watch.close()
        twin.terminate()
        twin.wait()


if __name__ == "__main__":
    main()
