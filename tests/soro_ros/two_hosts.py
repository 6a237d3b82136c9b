"""Two hosts with a cable between them: network namespaces, which end with the process that made them."""

from __future__ import annotations

import subprocess

ISOLATED = ["unshare", "--map-root-user", "--net", "--pid", "--fork", "--kill-child", "--mount-proc"]
"""Runs a program as root of namespaces of its own."""

CABLED = """
set -e
ip link set lo up
unshare -n sh -c 'while [ ! -e linked ]; do sleep 0.05; done; exec sh remote.sh' > remote.txt 2> remote.err &
# Until it has its own network.
until [ "$(readlink /proc/$!/ns/net)" != "$(readlink /proc/self/ns/net)" ]; do sleep 0.05; done
ip link add cable0 type veth peer name cable1 netns $!
ip addr add 10.11.0.1/24 dev cable0
ip link set cable0 up
nsenter -t $! -n ip link set lo up
nsenter -t $! -n ip addr add 10.11.0.2/24 dev cable1
nsenter -t $! -n ip link set cable1 up
# The middleware leaves out an interface without carrier, which comes up to a second later.
until ip link show cable0 | grep -q "state UP" &&
    nsenter -t $! -n ip link show cable1 | grep -q "state UP"; do
    sleep 0.05
done
touch linked
"""
"""Begin of a script of bash: remote.sh of the working directory runs on the other host, the rest on this one.

The cable is `cable0` here. remote.txt and remote.err have what remote.sh prints.
"""


def possible() -> bool:
    """Whether this machine permits namespaces and has the programs."""
    try:
        probe = [*ISOLATED, "sh", "-c", "ip link add cable0 type veth peer name cable1 && nsenter --version"]
        return subprocess.run(probe, capture_output=True, timeout=10).returncode == 0
    except (OSError, subprocess.TimeoutExpired):
        return False
